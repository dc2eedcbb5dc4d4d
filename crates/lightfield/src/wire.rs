//! Sections of a `lightfield` file: "LFFM" (counts and settings), "LFME" (mesh and sides of patches), "LFMN" (the mean's planes), then
//! for each term "LFQ0" (scales), "LFG0" (surface maps) and "LFH0" (view maps), with the term's number as last letter.
//! A file that ends after a term is a light field of fewer terms.

use glam::Vec3;
use texfold_bc::{Content, ContentPlanes};
use texfold_core::container::{Notes, Reader, SectionWriter, Sections};
use texfold_core::{Budget, LoadError, String4, Texel};

use crate::Mesh;
use crate::capture::{MAX_TRIANGLES, MAX_VERTICES};
use crate::encoded::{LightTexture, PIXEL, Parts, mean_size, surface_size, view_size};
use crate::layout::{Layout, MAX_SIDE_LOG2};
use crate::params::{Directions, Factors, MAX_TERMS};

const FORM_ID: [u8; 4] = *b"LFFM";
const MESH_ID: [u8; 4] = *b"LFME";
const MEAN_ID: [u8; 4] = *b"LFMN";

/// Coordinates beyond this are taken for damage: squares of their differences must stay finite.
const MAX_COORDINATE: f32 = 1e9;

fn term_id(kind: u8, term: u32) -> [u8; 4] {
    [b'L', b'F', kind, b'0' + term as u8]
}

pub(crate) fn store(parts: &Parts, out: &mut SectionWriter) {
    let (vertices, triangles) = (parts.mesh.positions.len(), parts.mesh.triangles.len());
    let directions = match parts.directions {
        Directions::View => 0u8,
        Directions::Reflected => 1,
    };
    let factors = match parts.factors {
        Factors::Signed => 0u8,
        Factors::NonNegative => 1,
    };
    let mut form = Vec::new();
    form.extend([vertices as u32, triangles as u32].map(u32::to_le_bytes).concat());
    form.extend([parts.total_terms as u8, parts.grid as u8, directions, factors]);
    form.extend([parts.mean.content().number(), parts.surface.content().number()]);
    out.section("container", FORM_ID, &form);
    out.section("mesh", MESH_ID, &mesh_bytes(parts));
    out.section("mean", MEAN_ID, &rows_of(&parts.mean, 0, 1));
    for term in 0..parts.terms {
        let scales = 3 * vertices;
        let first = term as usize * scales;
        out.section("scales", term_id(b'Q', term), &parts.scales[first..first + scales]);
        out.section("surface maps", term_id(b'G', term), &rows_of(&parts.surface, term, parts.terms));
        out.section("view maps", term_id(b'H', term), &rows_of(&parts.view, term, parts.terms));
    }
}

/// Places byte by byte (all lowest bytes of x, then the next, so that alike bytes stand together), indices as the difference
/// to the index before, byte by byte, then the sides.
fn mesh_bytes(parts: &Parts) -> Vec<u8> {
    let mut raw = Vec::new();
    for axis in 0..3 {
        let values: Vec<[u8; 4]> = parts.mesh.positions.iter().map(|p| p[axis].to_le_bytes()).collect();
        (0..4).for_each(|byte| raw.extend(values.iter().map(|value| value[byte])));
    }
    let mut before = 0u32;
    let mut differences = Vec::new();
    for &index in parts.mesh.triangles.as_flattened() {
        differences.push(index.wrapping_sub(before).to_le_bytes());
        before = index;
    }
    (0..4).for_each(|byte| raw.extend(differences.iter().map(|value| value[byte])));
    raw.extend(&parts.sides_log2);
    raw
}

/// The bytes of one of `terms` equal bands of rows, plane by plane; each byte as the difference to the one before of the same channel
/// where texels are plain.
fn rows_of(planes: &ContentPlanes, term: u32, terms: u32) -> Vec<u8> {
    let mut raw = Vec::new();
    for (format, bytes) in planes.planes() {
        let band = bytes.len() / terms as usize;
        let band = &bytes[term as usize * band..(term as usize + 1) * band];
        if planes.content() == Content::Raw {
            let step = format.block_bytes() as usize;
            let before = |at: usize| at.checked_sub(step).map_or(0, |at| band[at]);
            raw.extend(band.iter().enumerate().map(|(at, byte)| byte.wrapping_sub(before(at))));
        } else {
            raw.extend(band);
        }
    }
    raw
}

struct Form {
    vertices: u32,
    triangles: u32,
    terms: u32,
    grid: u32,
    directions: Directions,
    factors: Factors,
    mean: Content,
    maps: Content,
}

pub(crate) fn load(file: &Sections<'_>, budget: &mut Budget) -> Result<LightTexture, LoadError> {
    let notes = Notes::read(file, budget)?;
    let raw = file.read(FORM_ID, budget)?;
    let form = read_form(&mut Reader::new(String4(FORM_ID), &raw))?;
    let raw = file.read(MESH_ID, budget)?;
    let mut reader = Reader::new(String4(MESH_ID), &raw);
    let (mesh, sides_log2) = read_mesh(&mut reader, &form, budget)?;
    let layout = Layout::new(&sides_log2, form.vertices, form.grid, form.terms)
        .ok_or(reader.corrupt("maps that do not fit a texture"))?;
    let mut mean = Bands::new(form.mean, mean_size(&layout));
    mean.read(file, MEAN_ID, budget)?;
    let mut surface = Bands::new(form.maps, surface_size(&layout, u32::from(form.terms > 0)));
    let mut view = Bands::new(form.maps, view_size(&layout, form.grid, u32::from(form.terms > 0)));
    let mut scales = Vec::new();
    let mut terms = 0;
    let ids = |term| [b'Q', b'G', b'H'].map(|kind| term_id(kind, term));
    while terms < form.terms && ids(terms).iter().all(|&id| file.has(id)) {
        let [scale_id, surface_id, view_id] = ids(terms);
        let raw = file.read(scale_id, budget)?;
        if raw.len() as u64 != 3 * u64::from(form.vertices) {
            return Err(Reader::new(String4(scale_id), &raw).corrupt("another number of scales"));
        }
        scales.extend(raw);
        surface.read(file, surface_id, budget)?;
        view.read(file, view_id, budget)?;
        terms += 1;
    }
    budget
        .take((6 + 3 * u64::from(terms)) * 4 * u64::from(form.vertices) + 16 * u64::from(form.triangles))?;
    let parts = Parts {
        mesh,
        sides_log2,
        directions: form.directions,
        factors: form.factors,
        grid: form.grid,
        total_terms: form.terms,
        terms,
        scales,
        mean: mean.planes(mean_size(&layout), budget)?,
        surface: surface.planes(surface_size(&layout, terms), budget)?,
        view: view.planes(view_size(&layout, form.grid, terms), budget)?,
    };
    Ok(LightTexture::new(parts, &layout, notes))
}

fn read_form(reader: &mut Reader<'_>) -> Result<Form, LoadError> {
    let (vertices, triangles) = (reader.u32()?, reader.u32()?);
    let [terms, grid, directions, factors] = reader.array()?.map(u32::from);
    let (mean, maps) = (Content::read(reader)?, Content::read(reader)?);
    reader.end()?;
    let holds = |content| matches!(content, Content::Raw | Content::Bc1 | Content::Bc7);
    let directions = match directions {
        0 => Directions::View,
        1 => Directions::Reflected,
        _ => return Err(reader.corrupt("unknown kind of directions")),
    };
    let factors = match factors {
        0 => Factors::Signed,
        1 => Factors::NonNegative,
        _ => return Err(reader.corrupt("unknown kind of factors")),
    };
    match () {
        () if vertices == 0 || vertices as usize > MAX_VERTICES => {
            Err(reader.corrupt("no or too many vertices"))
        }
        () if triangles == 0 || triangles as usize > MAX_TRIANGLES => {
            Err(reader.corrupt("no or too many triangles"))
        }
        () if terms > MAX_TERMS => Err(reader.corrupt("more than 8 terms")),
        () if !(4..=64).contains(&grid) || !grid.is_multiple_of(4) => {
            Err(reader.corrupt("view maps of a side that is no multiple of 4 in 4..=64"))
        }
        () if !holds(mean) || !holds(maps) => Err(reader.corrupt("content that holds no light-field maps")),
        () => Ok(Form { vertices, triangles, terms, grid, directions, factors, mean, maps }),
    }
}

fn read_mesh(
    reader: &mut Reader<'_>,
    form: &Form,
    budget: &mut Budget,
) -> Result<(Mesh, Vec<u8>), LoadError> {
    let (vertices, triangles) = (form.vertices as usize, form.triangles as usize);
    let mut positions: Vec<Vec3> = budget.zeroed(u64::from(form.vertices))?;
    for axis in 0..3 {
        for (at, word) in read_words(reader, vertices)?.enumerate() {
            let value = f32::from_bits(word);
            if !value.is_finite() || value.abs() > MAX_COORDINATE {
                return Err(reader.corrupt("a place that is not finite or too far away"));
            }
            positions[at][axis] = value;
        }
    }
    let mut indices: Vec<[u32; 3]> = budget.zeroed(u64::from(form.triangles))?;
    let mut before = 0u32;
    for (index, difference) in indices.as_flattened_mut().iter_mut().zip(read_words(reader, 3 * triangles)?) {
        before = before.wrapping_add(difference);
        *index = before;
    }
    if indices.as_flattened().iter().any(|&index| index >= form.vertices) {
        return Err(reader.corrupt("a triangle of a vertex that does not exist"));
    }
    let sides = reader.bytes(triangles)?.to_vec();
    if sides.iter().any(|&log2| log2 > MAX_SIDE_LOG2) {
        return Err(reader.corrupt("a patch of more than 64 texels a side"));
    }
    reader.end()?;
    Ok((Mesh { positions, triangles: indices }, sides))
}

/// `count` words of which all lowest bytes come first, then all next ones.
fn read_words<'r>(
    reader: &mut Reader<'r>,
    count: usize,
) -> Result<impl Iterator<Item = u32> + use<'r>, LoadError> {
    let planes = [reader.bytes(count)?, reader.bytes(count)?, reader.bytes(count)?, reader.bytes(count)?];
    Ok((0..count).map(move |at| u32::from_le_bytes(planes.map(|plane| plane[at]))))
}

/// Planes that arrive in bands of rows.
struct Bands {
    content: Content,
    /// Columns and rows of a band.
    size: (u32, u32),
    planes: Vec<Vec<u8>>,
}

impl Bands {
    fn new(content: Content, size: (u32, u32)) -> Bands {
        Bands { content, size, planes: vec![Vec::new(); content.formats(PIXEL).0.len()] }
    }

    fn read(&mut self, file: &Sections<'_>, id: [u8; 4], budget: &mut Budget) -> Result<(), LoadError> {
        let raw = file.read(id, budget)?;
        let mut reader = Reader::new(String4(id), &raw);
        for (plane, format) in self.planes.iter_mut().zip(self.content.formats(PIXEL).0) {
            let length = format.bytes(self.size.0, self.size.1);
            budget.take(length)?;
            let (start, step) = (plane.len(), format.block_bytes() as usize);
            plane.extend(reader.bytes(length as usize)?);
            if self.content == Content::Raw {
                for at in start + step..plane.len() {
                    plane[at] = plane[at].wrapping_add(plane[at - step]);
                }
            }
        }
        reader.end()
    }

    /// The whole, of columns and rows `size`; zeros where no band has come.
    fn planes(mut self, size: (u32, u32), budget: &mut Budget) -> Result<ContentPlanes, LoadError> {
        let texels = u64::from(size.0) * u64::from(size.1);
        budget.check_texels(texels)?;
        budget.take(texels * size_of::<Texel>() as u64)?;
        for (plane, format) in self.planes.iter_mut().zip(self.content.formats(PIXEL).0) {
            plane.resize(format.bytes(size.0, size.1) as usize, 0);
        }
        let whole = ContentPlanes::from_planes(self.content, PIXEL, size, self.planes);
        whole.ok_or(LoadError::Corrupt {
            section: String4(FORM_ID),
            offset: 0,
            what: "planes of another size",
        })
    }
}
