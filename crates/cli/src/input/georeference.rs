//! Georeferences: an image's GeoTIFF tags (OGC GeoTIFF 1.1), GDAL's metadata and the meaning of bands, kept as a TIFF file of
//! one texel.

use std::io::{BufRead, Cursor, Seek, Write};
use std::path::Path;

use texfold_core::container::{MAX_GEOREFERENCE, Notes};
use texfold_core::{ImageSize, Rect};
use tiff::TiffResult;
use tiff::decoder::Decoder;
use tiff::encoder::colortype::{ColorType, Gray8, RGB8};
use tiff::encoder::{DirectoryEncoder, TiffEncoder, TiffKind};
use tiff::tags::{ExtraSamples, Tag};

use super::Remarks;
use super::samples::{self, Bands, GDAL_METADATA};

/// Keys of the directory: kind of raster, projected and geographic coordinate system.
const RASTER_TYPE: u16 = 1025;
const PROJECTED: u16 = 3072;
const GEOGRAPHIC: u16 = 2048;
/// Value of [`RASTER_TYPE`] where coordinates are those of texels' centres.
const POINT: u16 = 2;
/// Code of a coordinate system that the tags define themselves.
const USER_DEFINED: u16 = 32767;
/// Code of values that are stored in their entry of the directory.
const IN_PLACE: u16 = 0;

/// The tags that give an image its place on Earth and its bands their meaning.
#[derive(Debug, Clone, PartialEq, Default)]
pub(crate) struct Georeference {
    /// Size of a texel: 3 numbers, or none.
    scale: Vec<f64>,
    /// Column, row, depth, and the coordinates there: 6 numbers each.
    tie_points: Vec<f64>,
    /// From column, row, depth to coordinates: 4x4 by rows, or none.
    matrix: Vec<f64>,
    /// Header and entries of 4 numbers: the coordinate system.
    keys: Vec<u16>,
    doubles: Vec<f64>,
    text: String,
    /// Value of texels without data, as GDAL writes it.
    no_data: String,
    /// GDAL's metadata.
    metadata: String,
    bands: Option<Bands>,
}

/// The value of a tag.
#[derive(Debug, Clone, Copy)]
pub(crate) enum TagValue<'a> {
    Doubles(&'a [f64]),
    Shorts(&'a [u16]),
    Text(&'a str),
}

impl TagValue<'_> {
    fn is_empty(self) -> bool {
        match self {
            TagValue::Doubles(numbers) => numbers.is_empty(),
            TagValue::Shorts(numbers) => numbers.is_empty(),
            TagValue::Text(text) => text.is_empty(),
        }
    }
}

/// A part of an image at a mip level.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Part {
    /// Left and top edge in texels of the level.
    pub(crate) corner: (u32, u32),
    /// Columns and rows of the image for each of the level.
    pub(crate) ratio: (f64, f64),
}

impl Part {
    /// A rectangle of a level of an image of size `whole`.
    pub(crate) fn of(whole: ImageSize, rect: Rect) -> Part {
        let level = whole.at_level(rect.level);
        let ratio = |whole: u32, level: u32| f64::from(whole) / f64::from(level);
        let ratio = (ratio(whole.width, level.width), ratio(whole.height, level.height));
        Part { corner: (rect.x, rect.y), ratio }
    }
}

impl Georeference {
    /// Georeference of the first image of a TIFF file; `None` where it has neither a place nor bands, or an incomplete one.
    pub(crate) fn of_file(path: &Path) -> Option<Georeference> {
        let head = super::head_of(path).ok()?;
        super::frames::is_tiff(&head)
            .then(|| crate::files::open(path).ok().map(std::io::BufReader::new))
            .flatten()
            .and_then(Self::read)
    }

    /// Georeference in a texture's notes.
    pub(crate) fn of_notes(notes: &Notes) -> Option<Georeference> {
        Georeference::parse(&notes.source.as_ref()?.georeference)
    }

    /// Georeference in the bytes that notes hold.
    pub(crate) fn parse(bytes: &[u8]) -> Option<Georeference> {
        Georeference::read(Cursor::new(bytes))
    }

    fn read(file: impl BufRead + Seek) -> Option<Georeference> {
        let mut decoder = Decoder::new(file).ok()?;
        let mut numbers = |tag| decoder.get_tag_f64_vec(tag).unwrap_or_default();
        let found = Georeference {
            scale: numbers(Tag::ModelPixelScaleTag),
            tie_points: numbers(Tag::ModelTiepointTag),
            matrix: numbers(Tag::ModelTransformationTag),
            doubles: numbers(Tag::GeoDoubleParamsTag),
            keys: decoder.get_tag_u16_vec(Tag::GeoKeyDirectoryTag).unwrap_or_default(),
            text: decoder.get_tag_ascii_string(Tag::GeoAsciiParamsTag).unwrap_or_default(),
            no_data: decoder.get_tag_ascii_string(Tag::GdalNodata).unwrap_or_default(),
            metadata: samples::metadata(&mut decoder),
            bands: Bands::of(&mut decoder),
        };
        found.is_usable().then_some(found)
    }

    fn is_usable(&self) -> bool {
        let places = [&self.scale, &self.tie_points, &self.matrix];
        (self.has_place() || self.bands.is_some())
            && places.into_iter().flatten().all(|number| number.is_finite())
            && matches!(self.scale.len(), 0 | 3)
            && self.tie_points.len().is_multiple_of(6)
            && matches!(self.matrix.len(), 0 | 16)
    }

    fn has_place(&self) -> bool {
        self.matrix.len() == 16 || !self.tie_points.is_empty()
    }

    /// The bands of texels that have more than gray or RGB and alpha.
    pub(crate) fn bands(&self) -> Option<Bands> {
        self.bands
    }

    /// The sample that stands for no data, where it is a whole one.
    pub(crate) fn no_data(&self) -> Option<u32> {
        self.no_data
            .trim_end_matches('\0')
            .trim()
            .parse::<f64>()
            .ok()
            .filter(|value| value.fract() == 0.0)
            .and_then(|value| (0.0..=f64::from(u16::MAX)).contains(&value).then_some(value as u32))
    }

    /// A TIFF file of one texel with these tags; `None` where it is longer than notes may hold.
    fn to_bytes(&self) -> Option<Vec<u8>> {
        let mut out = Cursor::new(Vec::new());
        let mut encoder = TiffEncoder::new(&mut out).ok()?;
        match self.bands {
            Some(bands) if bands.is_rgb => self.write_texel::<RGB8>(&mut encoder, bands.count).ok()?,
            bands => self.write_texel::<Gray8>(&mut encoder, bands.map_or(1, |bands| bands.count)).ok()?,
        }
        Some(out.into_inner()).filter(|bytes| bytes.len() <= MAX_GEOREFERENCE)
    }

    fn write_texel<C: ColorType<Inner = u8>>(
        &self,
        encoder: &mut TiffEncoder<&mut Cursor<Vec<u8>>>,
        samples: u16,
    ) -> TiffResult<()> {
        let mut image = encoder.new_image::<C>(1, 1)?;
        let colours = C::BITS_PER_SAMPLE.len();
        image.extra_samples(&vec![ExtraSamples::Unspecified; usize::from(samples) - colours])?;
        self.write(image.encoder())?;
        image.write_data(&vec![0; samples.into()])
    }

    /// Adds the tags to those of an image.
    pub(crate) fn write<W: Write + Seek, K: TiffKind>(
        &self,
        image: &mut DirectoryEncoder<'_, W, K>,
    ) -> TiffResult<()> {
        self.tags().into_iter().try_for_each(|(tag, value)| match value {
            TagValue::Doubles(numbers) => image.write_tag(tag, numbers),
            TagValue::Shorts(numbers) => image.write_tag(tag, numbers),
            TagValue::Text(text) => image.write_tag(tag, text),
        })
    }

    /// Tags with their values, without empty ones.
    pub(crate) fn tags(&self) -> Vec<(Tag, TagValue<'_>)> {
        let all = [
            (Tag::ModelPixelScaleTag, TagValue::Doubles(&self.scale)),
            (Tag::ModelTiepointTag, TagValue::Doubles(&self.tie_points)),
            (Tag::ModelTransformationTag, TagValue::Doubles(&self.matrix)),
            (Tag::GeoDoubleParamsTag, TagValue::Doubles(&self.doubles)),
            (Tag::GeoKeyDirectoryTag, TagValue::Shorts(&self.keys)),
            (Tag::GeoAsciiParamsTag, TagValue::Text(&self.text)),
            (Tag::GdalNodata, TagValue::Text(&self.no_data)),
            (GDAL_METADATA, TagValue::Text(&self.metadata)),
        ];
        all.into_iter().filter(|(_, value)| !value.is_empty()).collect()
    }

    /// The georeference of a part of the image.
    pub(crate) fn of_part(&self, Part { corner, ratio }: Part) -> Georeference {
        let mut part = self.clone();
        let corner = (f64::from(corner.0), f64::from(corner.1));
        // Coordinates of centres are half a texel off those of edges, at every level.
        let half = self.half();
        for point in part.tie_points.chunks_exact_mut(6) {
            point[0] = (point[0] + half) / ratio.0 - corner.0 - half;
            point[1] = (point[1] + half) / ratio.1 - corner.1 - half;
        }
        if let [across, down, _] = part.scale.as_mut_slice() {
            (*across, *down) = (*across * ratio.0, *down * ratio.1);
        }
        for row in part.matrix.chunks_exact_mut(4).take(3) {
            let first = ((corner.0 + half) * ratio.0 - half, (corner.1 + half) * ratio.1 - half);
            row[3] += row[0] * first.0 + row[1] * first.1;
            (row[0], row[1]) = (row[0] * ratio.0, row[1] * ratio.1);
        }
        part
    }

    /// Distance from a texel's edge to the point that its column and row stand for, in texels.
    fn half(&self) -> f64 {
        if self.key(RASTER_TYPE) == Some(POINT) { 0.5 } else { 0.0 }
    }

    /// The value of a key of the directory that is stored in its entry.
    fn key(&self, wanted: u16) -> Option<u16> {
        let entries = self.keys.chunks_exact(4).skip(1);
        let mut found = entries.filter(|entry| entry[0] == wanted && entry[1] == IN_PLACE);
        found.next().map(|entry| entry[3])
    }

    /// One line: coordinate system, upper left corner of the upper left texel, size of a texel. `None` where there is no place.
    pub(crate) fn description(&self) -> Option<String> {
        self.has_place().then(|| self.place())
    }

    fn place(&self) -> String {
        let code = self.key(PROJECTED).or_else(|| self.key(GEOGRAPHIC));
        let system = match code {
            Some(code) if code != USER_DEFINED => format!("EPSG:{code}"),
            _ => "a coordinate system without code".to_owned(),
        };
        let edge = -self.half();
        let place = match (self.matrix.as_slice(), self.tie_points.as_slice(), self.scale.as_slice()) {
            (&[a, b, _, left, c, d, _, top, ..], ..) => {
                Some(((left + (a + b) * edge, top + (c + d) * edge), (a.hypot(c), b.hypot(d))))
            }
            (_, &[column, row, _, x, y, ..], &[across, down, _]) => {
                Some(((x + (edge - column) * across, y - (edge - row) * down), (across, down)))
            }
            _ => None,
        };
        match place {
            Some(((left, top), (across, down))) => {
                format!("{system}, upper left {left}, {top}, a texel is {across} x {down}")
            }
            None => format!("{system}, {} control points", self.tie_points.len() / 6),
        }
    }
}

/// The georeference of an input, for its notes: that of its only file, which has one image.
pub(crate) fn of_input(files: &[impl AsRef<Path>], images: usize, remarks: &mut Remarks) -> Vec<u8> {
    let mut all =
        files.iter().map(AsRef::as_ref).filter_map(|path| Some((path, Georeference::of_file(path)?)));
    let Some((path, georeference)) = all.next() else { return Vec::new() };
    let own_images = georeference.bands().map_or(1, Bands::images);
    if files.len() > 1 || images > own_images.into() {
        if georeference.has_place() {
            remarks.warn(path, "georeferences are kept of single images, not of sets");
        }
        return Vec::new();
    }
    let is_upright = super::pixels::size_and_orientation(path)
        .is_ok_and(|(_, orientation)| orientation == image::metadata::Orientation::NoTransforms);
    let bytes = || {
        georeference.to_bytes().or_else(|| {
            remarks.warn(path, "GDAL's metadata is not kept: it is too long");
            Georeference { metadata: String::new(), ..georeference.clone() }.to_bytes()
        })
    };
    let kept = is_upright.then(bytes).flatten();
    if kept.is_none() {
        remarks.warn(path, "the georeference is not kept: it is too long, or the image is stored turned");
    }
    kept.unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn utm(raster_type: u16) -> Georeference {
        Georeference {
            scale: vec![0.6, 0.6, 0.0],
            tie_points: vec![0.0, 0.0, 0.0, 266_688.0, 5_289_402.0, 0.0],
            keys: vec![1, 1, 0, 2, RASTER_TYPE, 0, 1, raster_type, PROJECTED, 0, 1, 26915],
            text: "NAD83 / UTM zone 15N|".to_owned(),
            no_data: "-9999".to_owned(),
            ..Georeference::default()
        }
    }

    /// The same place by a matrix.
    fn by_matrix(from: &Georeference) -> Georeference {
        let rows =
            [[0.6, 0.0, 0.0, 266_688.0], [0.0, -0.6, 0.0, 5_289_402.0], [0.0; 4], [0.0, 0.0, 0.0, 1.0]];
        let matrix = rows.concat();
        Georeference { scale: Vec::new(), tie_points: Vec::new(), matrix, ..from.clone() }
    }

    /// Coordinates of the edge or centre that column and row 0 stand for.
    fn origin(georeference: &Georeference) -> (f64, f64) {
        match (georeference.matrix.as_slice(), georeference.tie_points.as_slice()) {
            (&[_, _, _, x, _, _, _, y, ..], _) => (x, y),
            (_, &[column, row, _, x, y, ..]) => {
                (x - column * georeference.scale[0], y + row * georeference.scale[1])
            }
            _ => panic!("no place"),
        }
    }

    #[test]
    fn tags_survive() {
        let bands = Georeference {
            bands: Some(Bands { count: 13, is_rgb: false }),
            metadata: "<GDALMetadata></GDALMetadata>".to_owned(),
            ..Georeference::default()
        };
        let colours = Georeference { bands: Some(Bands { count: 4, is_rgb: true }), ..utm(1) };
        for georeference in [utm(1), by_matrix(&utm(2)), bands, colours] {
            assert_eq!(Georeference::parse(&georeference.to_bytes().unwrap()), Some(georeference));
        }
        let damaged = [
            Georeference { tie_points: vec![1.0; 5], ..utm(1) },
            Georeference { tie_points: Vec::new(), ..utm(1) },
            Georeference { scale: vec![f64::NAN, 1.0, 1.0], ..utm(1) },
            Georeference { scale: vec![1.0; 2], ..utm(1) },
        ];
        for damaged in damaged {
            assert_eq!(Georeference::parse(&damaged.to_bytes().unwrap()), None, "{damaged:?}");
        }
        let long = Georeference { tie_points: vec![1.0; 6 * 2000], ..utm(1) };
        assert_eq!(long.to_bytes(), None);
        assert_eq!(Georeference::parse(b"II*\0"), None);
    }

    #[test]
    fn parts_keep_their_place() {
        // By hand: 100 columns and 50 rows of 0.6 further, and texels of 4 x 2 times the size.
        let part = Part { corner: (25, 25), ratio: (4.0, 2.0) };
        for whole in [utm(1), by_matrix(&utm(1))] {
            let (x, y) = origin(&whole.of_part(part));
            assert!((x - 266_748.0).abs() < 1e-6 && (y - 5_289_372.0).abs() < 1e-6, "{x} {y}");
        }
        // The centre of the part's first texel lies 1.5 columns and half a row further than that of the image's texel there.
        for whole in [utm(2), by_matrix(&utm(2))] {
            let (x, y) = origin(&whole.of_part(part));
            assert!((x - 266_748.9).abs() < 1e-6 && (y - 5_289_371.7).abs() < 1e-6, "{x} {y}");
        }
        assert_eq!(utm(1).of_part(part).scale[..2], [2.4, 1.2]);
    }

    #[test]
    fn descriptions_name_the_system_and_the_corner() {
        let text = "EPSG:26915, upper left 266688, 5289402, a texel is 0.6 x 0.6";
        assert_eq!(utm(1).description().as_deref(), Some(text));
        assert_eq!(by_matrix(&utm(1)).description().as_deref(), Some(text));
        let centred = utm(2).description().unwrap();
        assert!(centred.contains("upper left 266687.7, 5289402.3"), "{centred}");
        assert_eq!(by_matrix(&utm(2)).description(), Some(centred));
        let points = Georeference { scale: Vec::new(), keys: Vec::new(), ..utm(1) };
        let text = "a coordinate system without code, 1 control points";
        assert_eq!(points.description().as_deref(), Some(text));
    }
}
