//! Pairs of photographs that show the same, and pairs that do not, made of real images by a seed.

use std::path::{Path, PathBuf};

use glam::{DMat3, DVec2, DVec3};
use texfold_benches::report::Outcome;
use texfold_testkit::rng::Rng;

use super::picture::{Picture, moved};

/// Folders of images, and whether they are searched for repetitive ones too.
const FOLDERS: [(&str, bool); 10] = [
    ("images", true),
    ("epitome", true),
    ("epitome/collection_lund", false),
    ("pbr", true),
    ("remote", false),
    ("vq/kodak", false),
    ("zipmap/boat", false),
    ("zipmap/city100_nikon", false),
    ("zipmap/opencv", false),
    ("zipmap/vlfeat_river", false),
];
/// Images whose names begin alike, or that lie in one of these folders, show one thing: no false pair is made of two of
/// them, and all of them are on one side of the division in halves.
const ALIKE: [&str; 10] = [
    "collection_lund",
    "FlightHelmet_Leather",
    "FlightHelmet_Metal",
    "Sponza",
    "mtlx",
    "naip",
    "boat",
    "city100",
    "opencv",
    "vlfeat",
];
/// Images are cut to their middle texels, at most so many a side.
const SOURCE_SIDE: u32 = 1600;
/// Longer side of a photograph in pixels, before it is made smaller to fit.
const SIDES: (f64, f64) = (400.0, 640.0);
/// Shortest longer side.
const LEAST_SIDE: f64 = 256.0;
/// Height of a photograph as a share of its width.
const ASPECT: f64 = 0.75;
/// Focal length in widths of the photograph.
const FOCAL: f64 = 1.6;
/// Texels of the image to a pixel of the finer photograph.
const TEXELS: (f64, f64) = (0.5, 1.5);
/// Tries until a pair of views fits.
const TRIES: usize = 20_000;
/// Fields a side, their least deviation, and the share of them that must show something: nobody tells where a smooth
/// wall was photographed.
const TEXTURED: (usize, f32, f64) = (8, 0.02, 0.6);
/// Pairs of each kind.
pub(crate) const EACH: usize = 20;
/// False pairs of each kind.
pub(crate) const EACH_FALSE: usize = 50;

/// What a pair shows beside two views of one thing.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Kind {
    Slant,
    Blur,
    Noise,
    Exposure,
    Haze,
    Covered,
    Moved,
    Faded,
    Jpeg,
    Several,
    Different,
    Parts,
    Repetitive,
    Tiled,
}

/// All true kinds.
pub(crate) const TRUE: [Kind; 10] = [
    Kind::Slant,
    Kind::Blur,
    Kind::Noise,
    Kind::Exposure,
    Kind::Haze,
    Kind::Covered,
    Kind::Moved,
    Kind::Faded,
    Kind::Jpeg,
    Kind::Several,
];
/// All false kinds.
pub(crate) const FALSE: [Kind; 4] = [Kind::Different, Kind::Parts, Kind::Repetitive, Kind::Tiled];

impl Kind {
    pub(crate) fn name(self) -> &'static str {
        match self {
            Kind::Slant => "slanted by 45 to 60 degrees",
            Kind::Blur => "blurred to a third",
            Kind::Noise => "noise of 3 to 8 %",
            Kind::Exposure => "exposure and contrast",
            Kind::Haze => "haze",
            Kind::Covered => "covered by 10 to 30 %",
            Kind::Moved => "a moved object",
            Kind::Faded => "faded colour",
            Kind::Jpeg => "JPEG of quality 8 to 25",
            Kind::Several => "three of these",
            Kind::Different => "different images",
            Kind::Parts => "parts of one image",
            Kind::Repetitive => "parts of one repetitive image",
            Kind::Tiled => "parts of one tile that repeats",
        }
    }
}

/// An image that photographs are made of.
#[derive(Debug)]
pub(crate) struct Source {
    path: PathBuf,
    group: String,
    repeats: bool,
    pub(crate) half: usize,
}

/// Two photographs.
#[derive(Debug)]
pub(crate) struct Pair {
    pub(crate) kind: Kind,
    pub(crate) names: [String; 2],
    pub(crate) photos: [Picture; 2],
    /// From pixels of the first to pixels of the second; `None` where nothing does.
    pub(crate) truth: Option<DMat3>,
    /// Pixels of the second to one of the first, in the middle.
    pub(crate) zoom: f64,
    /// Share of the smaller one that both show.
    pub(crate) overlap: f64,
}

/// All images below `data`, by name, every second group of them in the second half.
pub(crate) fn sources(data: &Path) -> Outcome<Vec<Source>> {
    let mut found = Vec::new();
    for (folder, repeats) in FOLDERS {
        let Ok(entries) = std::fs::read_dir(data.join(folder)) else { continue };
        for path in entries.flatten().map(|entry| entry.path()) {
            let name = format!("{folder}/{}", path.file_name().unwrap_or_default().to_string_lossy());
            let known = ["png", "jpg", "tif", "pgm"];
            if !path.extension().is_some_and(|end| known.iter().any(|known| end == *known)) {
                continue;
            }
            let group =
                ALIKE.iter().find(|alike| name.contains(*alike)).map_or(name, |&alike| alike.to_owned());
            found.push(Source { path, group, repeats, half: 0 });
        }
    }
    found.sort_by(|a, b| a.group.cmp(&b.group).then(a.path.cmp(&b.path)));
    let mut groups: Vec<String> = found.iter().map(|source| source.group.clone()).collect();
    groups.dedup();
    for source in &mut found {
        source.half = groups.iter().position(|group| *group == source.group).unwrap_or(0) % 2;
    }
    Ok(found)
}

impl Source {
    fn name(&self) -> String {
        self.path.file_stem().unwrap_or_default().to_string_lossy().into_owned()
    }

    fn open(&self) -> Outcome<Picture> {
        Picture::open(&self.path, SOURCE_SIDE)
    }
}

/// How one photograph sees an image.
#[derive(Debug, Clone, Copy)]
struct View {
    /// From its pixels to texels of the image.
    matrix: DMat3,
    size: DVec2,
    /// Texels to a pixel in its middle.
    texels: f64,
}

impl View {
    /// At a place, turned at random, slanted by between two angles in radians.
    fn random(middle: DVec2, texels: f64, side: f64, slants: (f64, f64), rng: &mut Rng) -> View {
        let size = DVec2::new(side, (ASPECT * side).round()).round();
        let (slant, axis) = (rng.between(slants.0, slants.1), rng.between(0.0, std::f64::consts::TAU));
        let turn = rng.between(0.0, std::f64::consts::TAU);
        // Of the plane, in pixels of its middle, to pixels.
        let mut tilt = DMat3::from_diagonal(DVec3::new(1.0, slant.cos(), 1.0));
        tilt.y_axis.z = slant.sin() / (FOCAL * side);
        let to_pixels = DMat3::from_translation(0.5 * size)
            * DMat3::from_angle(-axis)
            * tilt
            * DMat3::from_angle(axis + turn)
            * DMat3::from_scale(DVec2::splat(texels.recip()))
            * DMat3::from_translation(-middle);
        let matrix = to_pixels.inverse();
        View { matrix: matrix * (1.0 / matrix.z_axis.z), size, texels }
    }

    fn corners(&self) -> [DVec2; 4] {
        [DVec2::ZERO, DVec2::X, DVec2::ONE, DVec2::Y].map(|corner| moved(&self.matrix, corner * self.size))
    }

    fn lies_in(&self, extent: DVec2) -> bool {
        let front = [DVec2::ZERO, DVec2::X, DVec2::ONE, DVec2::Y]
            .iter()
            .all(|corner| (self.matrix * (*corner * self.size).extend(1.0)).z > 0.05);
        front
            && self
                .corners()
                .iter()
                .all(|corner| corner.cmpge(DVec2::ZERO).all() && corner.cmple(extent).all())
    }

    fn sees(&self, texel: DVec2) -> bool {
        let place = moved(&self.matrix.inverse(), texel);
        place.cmpge(DVec2::ZERO).all() && place.cmple(self.size).all()
    }

    /// Share of this view's texels that the other shows, of a grid.
    fn shared(&self, other: &View) -> f64 {
        const GRID: usize = 24;
        let low = self.corners().into_iter().reduce(DVec2::min).unwrap_or_default();
        let high = self.corners().into_iter().reduce(DVec2::max).unwrap_or_default();
        let (mut own, mut both) = (0, 0);
        for k in 0..GRID * GRID {
            let part = (DVec2::new((k % GRID) as f64, (k / GRID) as f64) + 0.5) / GRID as f64;
            let texel = low + (high - low) * part;
            if self.sees(texel) {
                own += 1;
                both += usize::from(other.sees(texel));
            }
        }
        f64::from(both as u32) / f64::from(own.max(1) as u32)
    }

    fn photo(&self, image: &Picture) -> Picture {
        let grid = (self.texels * 1.5).ceil().clamp(2.0, 8.0) as usize;
        image.view(&self.matrix, (self.size.x as usize, self.size.y as usize), grid)
    }
}

/// Two views of an image, the second `zoom` times as close; `wanted` are the bounds of the share that both show.
fn views(image: &Picture, kind: Kind, wanted: (f64, f64), rng: &mut Rng) -> Option<(View, View, f64)> {
    let extent = image.extent();
    let largest = if kind == Kind::Slant { 2.0 } else { 4.0 };
    let zoom = f64::powf(largest, rng.unit());
    let side = rng.between(SIDES.0, SIDES.1);
    let slants = if kind == Kind::Slant { (45.0, 60.0) } else { (0.0, 30.0) };
    let slants = (f64::to_radians(slants.0), f64::to_radians(slants.1));
    for step in 0..TRIES {
        // Smaller photographs, and at last smaller zooms, fit where large ones do not.
        let tried = step as f64 / TRIES as f64;
        let side = (side * (1.0 - 0.6 * tried)).max(LEAST_SIDE).round();
        let zoom = zoom.powf(1.0 - 0.5 * tried);
        let texels = rng.between(TEXELS.0, TEXELS.1.min(TEXELS.0 + 2.0 * (1.0 - tried)));
        let middle = extent * DVec2::new(rng.unit(), rng.unit());
        let wide = View::random(middle, texels * zoom, side, (0.0, slants.1.min(0.35)), rng);
        if !wide.lies_in(extent) {
            continue;
        }
        for _ in 0..8 {
            let middle = extent * DVec2::new(rng.unit(), rng.unit());
            let close = View::random(middle, texels, side, slants, rng);
            if !close.lies_in(extent) {
                continue;
            }
            let overlap = wide.shared(&close).max(close.shared(&wide));
            if overlap >= wanted.0 && overlap <= wanted.1 {
                return Some((wide, close, overlap));
            }
        }
    }
    None
}

/// Whether enough of what both show is there to be recognised.
fn has_texture(photo: &Picture, own: &View, other: &View) -> bool {
    let within = |place: DVec2| other.sees(moved(&own.matrix, place));
    photo.textured(TEXTURED.0, TEXTURED.1, within) >= TEXTURED.2
}

/// The pair of a number and kind, made of the images of one half; `None` where none can be made.
pub(crate) fn pair(sources: &[Source], kind: Kind, number: usize) -> Outcome<Option<Pair>> {
    let half = number % 2;
    let of_half: Vec<&Source> = sources.iter().filter(|source| source.half == half).collect();
    let mut rng = Rng::new(1 + 1000 * kind as u64 + number as u64);
    for _ in 0..100 {
        let first = of_half[rng.index(of_half.len())];
        if kind == Kind::Repetitive && !first.repeats {
            continue;
        }
        let second = of_half[rng.index(of_half.len())];
        let made = match kind {
            Kind::Different if first.group == second.group => None,
            Kind::Different => different([first, second], &mut rng)?,
            Kind::Parts | Kind::Repetitive => parts(first, kind, &mut rng)?,
            Kind::Tiled => tiled(first, &mut rng)?,
            _ => same(first, second, kind, &mut rng)?,
        };
        if made.is_some() {
            return Ok(made);
        }
    }
    Ok(None)
}

fn different(sources: [&Source; 2], rng: &mut Rng) -> Outcome<Option<Pair>> {
    let mut photos = Vec::new();
    for source in sources {
        let image = source.open()?;
        let Some((wide, ..)) = views(&image, Kind::Different, (0.0, 1.0), rng) else { return Ok(None) };
        photos.push(wide.photo(&image));
    }
    let [mut first, mut second]: [Picture; 2] = photos.try_into().map_err(|_| "two photographs")?;
    camera(&mut first, &mut second, rng);
    let names = sources.map(Source::name);
    Ok(Some(Pair {
        kind: Kind::Different,
        names,
        photos: [first, second],
        truth: None,
        zoom: 1.0,
        overlap: 0.0,
    }))
}

/// Two parts of one image that have nothing in common.
fn parts(source: &Source, kind: Kind, rng: &mut Rng) -> Outcome<Option<Pair>> {
    let image = source.open()?;
    let Some((wide, close, overlap)) = views(&image, kind, (0.0, 0.0), rng) else { return Ok(None) };
    let (mut first, mut second) = (wide.photo(&image), close.photo(&image));
    camera(&mut first, &mut second, rng);
    let zoom = wide.texels / close.texels;
    let names = [source.name(), source.name()];
    Ok(Some(Pair { kind, names, photos: [first, second], truth: None, zoom, overlap }))
}

/// Two photographs of a wall that shows one tile again and again, a whole number of tiles and a half apart, at other sizes.
fn tiled(source: &Source, rng: &mut Rng) -> Outcome<Option<Pair>> {
    let image = source.open()?;
    let tile = rng.between(48.0, 96.0);
    let corner = (image.extent() - 96.0) * DVec2::new(rng.unit(), rng.unit());
    let size = (480, 360);
    let wall = |middle: DVec2, scale: f64| {
        let data = (0..size.0 * size.1).map(|index| {
            let place = DVec2::new((index % size.0) as f64, (index / size.0) as f64) * scale + middle;
            image
                .view(&DMat3::from_translation(corner + place.rem_euclid(DVec2::splat(tile))), (1, 1), 1)
                .data[0]
        });
        Picture { width: size.0, height: size.1, data: data.collect() }
    };
    let (mut first, mut second) =
        (wall(DVec2::ZERO, 1.0), wall(DVec2::splat(2.4 * tile), rng.between(0.5, 1.0)));
    if first.textured(TEXTURED.0, TEXTURED.1, |_| true) < TEXTURED.2 {
        return Ok(None);
    }
    camera(&mut first, &mut second, rng);
    let names = [source.name(), source.name()];
    Ok(Some(Pair { kind: Kind::Tiled, names, photos: [first, second], truth: None, zoom: 1.0, overlap: 0.0 }))
}

/// What any two photographs differ in.
fn camera(first: &mut Picture, second: &mut Picture, rng: &mut Rng) {
    first.noise(0.006, rng);
    second.noise(0.006, rng);
}

fn same(source: &Source, other: &Source, kind: Kind, rng: &mut Rng) -> Outcome<Option<Pair>> {
    let image = source.open()?;
    let least = rng.between(0.3, 0.95);
    let Some((wide, close, overlap)) = views(&image, kind, (least, (least + 0.1).max(0.4)), rng) else {
        return Ok(None);
    };
    let mut photos = [wide.photo(&image), close.photo(&image)];
    if !has_texture(&photos[0], &wide, &close) || !has_texture(&photos[1], &close, &wide) {
        return Ok(None);
    }
    let other = other.open()?;
    let scene = Scene { views: [wide, close], other };
    let kinds = if kind == Kind::Several {
        let mut kinds = TRUE[1..9].to_vec();
        (0..3).map(|_| kinds.swap_remove(rng.index(kinds.len()))).collect()
    } else {
        vec![kind]
    };
    for kind in kinds {
        change(&mut photos, kind, &scene, rng)?;
    }
    let [first, second] = &mut photos;
    camera(first, second, rng);
    let truth = Some(close.matrix.inverse() * wide.matrix);
    let names = [source.name(), source.name()];
    Ok(Some(Pair { kind, names, photos, truth, zoom: wide.texels / close.texels, overlap }))
}

/// What is photographed, and something to cover it by.
struct Scene {
    views: [View; 2],
    other: Picture,
}

/// Changes one of two photographs, or both.
fn change(photos: &mut [Picture; 2], kind: Kind, scene: &Scene, rng: &mut Rng) -> Outcome<()> {
    let zoom = scene.views[0].texels / scene.views[1].texels;
    let which = rng.index(2);
    match kind {
        // What is wide and blurred to a third is as a zoom of three times as much.
        Kind::Blur => photos[if zoom > 4.0 / 3.0 { 1 } else { which }].blur(),
        Kind::Noise => {
            for photo in photos {
                photo.noise(rng.between(0.03, 0.08), rng);
            }
        }
        Kind::Exposure => photos.iter_mut().for_each(|photo| photo.expose(rng)),
        Kind::Haze => photos[which].haze(rng),
        Kind::Covered => cover(&mut photos[which], scene, rng),
        Kind::Moved => moves(photos, scene, rng),
        Kind::Faded => photos[which].fade(rng),
        Kind::Jpeg => {
            for photo in photos {
                photo.jpeg(8 + rng.below(18) as u8)?;
            }
        }
        _ => (),
    }
    Ok(())
}

/// Lays one to three ellipses over a photograph, 10 to 30 % of it.
fn cover(photo: &mut Picture, scene: &Scene, rng: &mut Rng) {
    let count = 1 + rng.below(3);
    let area = rng.between(0.1, 0.3) * photo.extent().element_product() / f64::from(count);
    for _ in 0..count {
        let aspect = rng.between(0.6, 1.6).sqrt();
        let radius = (area / std::f64::consts::PI).sqrt();
        let middle = photo.extent() * DVec2::new(rng.unit(), rng.unit());
        photo.cover(&scene.other, middle, DVec2::new(radius * aspect, radius / aspect));
    }
}

/// Lays one object over both photographs, at two places: 5 to 15 % of the closer one.
fn moves(photos: &mut [Picture; 2], scene: &Scene, rng: &mut Rng) {
    let area = rng.between(0.05, 0.15) * photos[1].extent().element_product();
    let radius = (area / std::f64::consts::PI).sqrt();
    let zoom = scene.views[0].texels / scene.views[1].texels;
    for (photo, view) in photos.iter_mut().zip(&scene.views) {
        let inside = DVec2::new(rng.between(0.2, 0.8), rng.between(0.2, 0.8));
        let scale = view.texels / scene.views[1].texels;
        photo.cover(&scene.other, photo.extent() * inside, DVec2::splat(radius / scale.min(zoom)));
    }
}
