//! Sections of a `lightfield` file: "LFFM" (counts and settings), "LFME" (mesh and sides of patches), "LFMN" (the mean's planes), then
//! for each term "LFQ0" (scales and which maps are used), "LFG0" (surface maps) and "LFH0" (view maps), with the term's number as last letter.
//! In blocks, instead of the planes: sections of block content 0, the mean, and for each term that has maps, after its "LFQ0", of a
//! block content with the number after the term's, which holds its surface maps and its view maps.
//! A file that ends after a term is a light field of fewer terms.

use glam::Vec3;
use texfold_bc::{Content, ContentPlanes};
use texfold_core::container::ContentId;
use texfold_core::container::{Notes, Reader, SectionWriter, Sections};
use texfold_core::{Budget, ImageSize, LoadError, String4, Texel};
use texfold_dct::DctContent;

use crate::Mesh;
use crate::kinds::{Directions, Factors, MAX_TERMS};
use crate::layout::{Layout, MAX_SIDE_LOG2, NONE, SIDES, Sharing, Widths, reduced};
use crate::layout::{MAX_TRIANGLES, MAX_VERTICES};
use crate::parts::{
    MAPS_PART, MEAN_PART, PIXEL, Parts, Payload, SURFACE_PART, TermRows, VIEW_PART, atlas_layout, mean_size,
    surface_size, view_size, words,
};

const FORM_ID: [u8; 4] = *b"LFFM";
const MESH_ID: [u8; 4] = *b"LFME";
const MEAN_ID: [u8; 4] = *b"LFMN";
/// Stands for a content where maps are in blocks of variable length.
const IN_BLOCKS: u8 = u8::MAX;

/// Coordinates beyond this are taken for damage: squares of their differences must stay finite.
const MAX_COORDINATE: f32 = 1e9;

/// Bytes of the number of a map, and room for the vector to grow by doubling.
const SHARING_BYTES: u64 = 12;

fn term_id(kind: u8, term: u32) -> [u8; 4] {
    [b'L', b'F', kind, b'0' + term as u8]
}

/// The block content of a term's maps; the mean's is the first of the file.
fn maps_id(term: u32) -> ContentId {
    // Terms are fewer than the numbers of contents.
    ContentId::new(term as u8 + 1).unwrap_or(ContentId::SECOND)
}

/// Writes all sections.
pub(crate) fn store(parts: &Parts, out: &mut SectionWriter) {
    let (vertices, triangles) = (parts.mesh.positions.len(), parts.mesh.triangles.len());
    let (directions, factors) = (parts.directions.number() as u8, parts.factors.number() as u8);
    let mut form = Vec::new();
    form.extend([vertices as u32, triangles as u32].map(u32::to_le_bytes).concat());
    form.extend([parts.total_terms as u8, parts.grid as u8, directions, factors]);
    form.extend(match &parts.payload {
        Payload::Planes { mean, surface, .. } => [mean.content().number(), surface.content().number()],
        Payload::Blocks { .. } => [IN_BLOCKS; 2],
    });
    let Widths { mean, surface, view } = parts.widths;
    form.extend([mean, surface, view].map(|width| (width as u16).to_le_bytes()).concat());
    form.push(parts.surface_reduce_log2);
    out.section("container", FORM_ID, &form);
    out.section("mesh", MESH_ID, &mesh_bytes(parts));
    let layout = parts.layout();
    match &parts.payload {
        Payload::Planes { mean, .. } => {
            out.section(MEAN_PART, MEAN_ID, &rows(mean, 0, layout.mean_rows()));
        }
        Payload::Blocks { mean, .. } => mean.store_as(MEAN_PART, ContentId::ONLY, out),
    }
    for term in 0..parts.terms {
        let scales = 3 * vertices;
        let first = term as usize * scales;
        let mut maps = parts.scales[first..first + scales].to_vec();
        push_sharing(&mut maps, &parts.layers[term as usize + 1]);
        let (begin, end) = (layout.rows(term), layout.rows(term + 1));
        out.section("scales and indices", term_id(b'Q', term), &maps);
        match &parts.payload {
            Payload::Planes { surface, view, .. } => {
                let surface = rows(surface, begin.surface, end.surface);
                out.section(SURFACE_PART, term_id(b'G', term), &surface);
                out.section(VIEW_PART, term_id(b'H', term), &rows(view, begin.view, end.view));
            }
            Payload::Blocks { terms, .. } => {
                if let Some(Some(maps)) = terms.get(term as usize) {
                    maps.store_as(MAPS_PART, maps_id(term), out);
                }
            }
        }
    }
}

/// The rows of a plane from `first` to `end`. An atlas without maps has a block all the same, which no section holds.
fn rows(planes: &ContentPlanes, first: u32, end: u32) -> Vec<u8> {
    rows_of(planes, if end > first { first..end } else { 0..0 })
}

/// Whether maps are shared; where they are, how many there are of each side and of view maps, and the numbers of those that are
/// used: all lowest bytes, all middle ones, all highest ones.
fn push_sharing(raw: &mut Vec<u8>, sharing: &Sharing) {
    raw.push(u8::from(sharing.shared));
    if !sharing.shared {
        return;
    }
    raw.extend(sharing.patches.iter().chain([&sharing.views]).flat_map(|count| count.to_le_bytes()));
    for numbers in [&sharing.patch_of, &sharing.view_of] {
        let used: Vec<[u8; 4]> =
            numbers.iter().filter(|&&number| number != NONE).map(|number| number.to_le_bytes()).collect();
        (0..3).for_each(|byte| raw.extend(used.iter().map(|number| number[byte])));
    }
}

/// Places byte by byte (all lowest bytes of x, then the next, so that alike bytes stand together), indices as the difference
/// to the index before, byte by byte, then the sides and which patches of the mean are used.
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
    push_sharing(&mut raw, &parts.layers[0]);
    raw
}

/// The bytes of some rows, multiples of a block's, plane by plane; each byte as the difference to the one before of the same channel where
/// texels are plain.
fn rows_of(planes: &ContentPlanes, rows: std::ops::Range<u32>) -> Vec<u8> {
    let mut raw = Vec::new();
    let width = planes.size().0;
    for (format, bytes) in planes.planes() {
        let [start, end] = [rows.start, rows.end].map(|row| format.bytes(width, row) as usize);
        let band = &bytes[start..end];
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

/// What "LFFM" says.
struct Form {
    vertices: u32,
    triangles: u32,
    terms: u32,
    grid: u32,
    directions: Directions,
    factors: Factors,
    /// Contents of the mean and of the maps; `None` where they are in blocks.
    contents: Option<[Content; 2]>,
    widths: Widths,
    surface_reduce_log2: u8,
}

/// What "LFME" holds.
struct MeshSection {
    mesh: Mesh,
    sides_log2: Vec<u8>,
    /// Which patches of the mean are used.
    mean: Sharing,
}

/// Reads all sections.
pub(crate) fn load(file: &Sections<'_>, budget: &mut Budget) -> Result<(Parts, Notes), LoadError> {
    let notes = Notes::read(file, budget)?;
    let raw = file.read(FORM_ID, budget)?;
    let form = read_form(&mut Reader::new(String4(FORM_ID), &raw))?;
    let raw = file.read(MESH_ID, budget)?;
    let mut reader = Reader::new(String4(MESH_ID), &raw);
    let MeshSection { mesh, sides_log2, mean } = read_mesh(&mut reader, &form, budget)?;
    let terms = (0..form.terms).take_while(|&term| is_whole(&form, file, term)).count() as u32;
    budget.take(u64::from(form.triangles))?;
    let coarse = reduced(&sides_log2, form.surface_reduce_log2);
    let per_term = 3 * mesh.positions.len();
    let mut scales: Vec<u8> = budget.zeroed(per_term as u64 * u64::from(terms))?;
    let mut layers = vec![mean];
    for (term, scales) in (0..terms).zip(scales.chunks_exact_mut(per_term)) {
        let id = term_id(b'Q', term);
        let raw = file.read(id, budget)?;
        let mut reader = Reader::new(String4(id), &raw);
        scales.copy_from_slice(reader.bytes(per_term)?);
        layers.push(read_term(&mut reader, &mesh, &coarse, scales, budget)?);
    }
    take_tables(&form, terms, budget)?;
    let layout = Layout::new([&sides_log2, &coarse], &layers, form.widths, form.grid)
        .ok_or(reader.corrupt("maps that do not fit a texture"))?;
    let payload = match form.contents {
        Some(contents) => load_planes((&form, contents), &layout, terms, file, budget)?,
        None => load_blocks(&form, &layout, terms, file, budget)?,
    };
    let parts = Parts {
        mesh,
        sides_log2,
        surface_reduce_log2: form.surface_reduce_log2,
        directions: form.directions,
        factors: form.factors,
        grid: form.grid,
        total_terms: form.terms,
        terms,
        scales,
        layers,
        widths: form.widths,
        payload,
    };
    Ok((parts, notes))
}

/// Whether all sections of a term have come.
fn is_whole(form: &Form, file: &Sections<'_>, term: u32) -> bool {
    if form.contents.is_some() {
        return [b'Q', b'G', b'H'].iter().all(|&kind| file.has(term_id(kind, term)));
    }
    // A term without maps has no blocks, and blocks may be all base.
    let blocks = DctContent::sections(maps_id(term));
    let is_missing = |id: [u8; 4]| file.ids().any(|(found, _)| found == id) && !file.has(id);
    file.has(term_id(b'Q', term)) && !blocks.into_iter().any(is_missing)
}

fn load_planes(
    (form, [mean, maps]): (&Form, [Content; 2]),
    layout: &Layout,
    terms: u32,
    file: &Sections<'_>,
    budget: &mut Budget,
) -> Result<Payload, LoadError> {
    let mut mean = Bands::new(mean, mean_size(layout, form.widths), budget)?;
    mean.read(file, MEAN_ID, layout.mean_rows(), budget)?;
    let mut surface = Bands::new(maps, surface_size(layout, form.widths, terms), budget)?;
    let mut view = Bands::new(maps, view_size(layout, form.widths, terms), budget)?;
    for term in 0..terms {
        let (begin, end) = (layout.rows(term), layout.rows(term + 1));
        surface.read(file, term_id(b'G', term), end.surface - begin.surface, budget)?;
        view.read(file, term_id(b'H', term), end.view - begin.view, budget)?;
    }
    Ok(Payload::Planes { mean: mean.planes()?, surface: surface.planes()?, view: view.planes()? })
}

fn load_blocks(
    form: &Form,
    layout: &Layout,
    terms: u32,
    file: &Sections<'_>,
    budget: &mut Budget,
) -> Result<Payload, LoadError> {
    let sizes = [
        mean_size(layout, form.widths),
        surface_size(layout, form.widths, terms),
        view_size(layout, form.widths, terms),
    ];
    for size in sizes {
        take_texels(size, budget)?;
    }
    let (width, height) = sizes[0];
    let of_mean = atlas_layout(vec![ImageSize { width, height }]);
    let mean = DctContent::load_whole(&of_mean, ContentId::ONLY, file, budget)?;
    let mut contents = Vec::new();
    for term in 0..terms {
        let maps = TermRows::of(layout, form.widths, term).layout();
        let maps = maps.map(|maps| DctContent::load_whole(&maps, maps_id(term), file, budget));
        contents.push(maps.transpose()?);
    }
    Ok(Payload::Blocks { mean, terms: contents })
}

/// Books the texels that the CPU decoder makes of an atlas.
fn take_texels((width, height): (u32, u32), budget: &mut Budget) -> Result<(), LoadError> {
    let texels = u64::from(width) * u64::from(height);
    budget.check_texels(texels)?;
    Ok(budget.take(texels * size_of::<Texel>() as u64)?)
}

/// Books what is made of the mesh and of the numbers of maps: where maps lie, smooth normals, and the shader's words as the CPU's table and as the
/// bytes of a plane.
fn take_tables(form: &Form, terms: u32, budget: &mut Budget) -> Result<(), LoadError> {
    let (vertices, triangles, layers) =
        (u64::from(form.vertices), u64::from(form.triangles), u64::from(terms));
    let places = triangles + layers * (3 * triangles + vertices);
    // Places are made once to be checked, and again for the words.
    let layouts = 2 * 4 * places;
    let normals = vertices * size_of::<Vec3>() as u64;
    Ok(budget.take(layouts + normals + 2 * 4 * words(vertices, triangles, terms))?)
}

/// Which maps of a term are used: by vertices with a scale that is not 0.
fn read_term(
    reader: &mut Reader<'_>,
    mesh: &Mesh,
    sides_log2: &[u8],
    scales: &[u8],
    budget: &mut Budget,
) -> Result<Sharing, LoadError> {
    let uses = |vertex: u32| scales[3 * vertex as usize..3 * vertex as usize + 3] != [0; 3];
    let corners = mesh.triangles.iter().zip(sides_log2);
    let corners = corners.flat_map(|(corners, &log2)| corners.map(|vertex| uses(vertex).then_some(log2)));
    budget.take(SHARING_BYTES * (3 * mesh.triangles.len() + mesh.positions.len()) as u64)?;
    let own = Sharing::own(corners, (0..mesh.positions.len() as u32).map(uses));
    let sides = |at: usize| sides_log2[at / 3];
    let sharing = read_sharing(reader, own, sides)?;
    reader.end()?;
    Ok(sharing)
}

/// Numbers of the maps that are used, where `own` says which are; and those where they are shared.
fn read_sharing(
    reader: &mut Reader<'_>,
    mut own: Sharing,
    sides_log2: impl Fn(usize) -> u8,
) -> Result<Sharing, LoadError> {
    match reader.array::<1>()? {
        [0] => return Ok(own),
        [1] => {}
        _ => return Err(reader.corrupt("maps neither shared nor own")),
    }
    own.shared = true;
    for count in own.patches.iter_mut().chain([&mut own.views]) {
        let stored = reader.u32()?;
        if stored > *count {
            return Err(reader.corrupt("more maps than are used"));
        }
        *count = stored;
    }
    let Sharing { patches, views, patch_of, view_of, .. } = &mut own;
    read_numbers(reader, patch_of, |at| patches[usize::from(sides_log2(at)).min(SIDES - 1)])?;
    read_numbers(reader, view_of, |_| *views)?;
    Ok(own)
}

/// Replaces all numbers that are not [`NONE`] by stored ones below `end` of their place.
fn read_numbers(
    reader: &mut Reader<'_>,
    numbers: &mut [u32],
    end: impl Fn(usize) -> u32,
) -> Result<(), LoadError> {
    let count = numbers.iter().filter(|&&number| number != NONE).count();
    let planes = [reader.bytes(count)?, reader.bytes(count)?, reader.bytes(count)?];
    let used = numbers.iter_mut().enumerate().filter(|(_, number)| **number != NONE);
    for (next, (at, number)) in used.enumerate() {
        *number = u32::from_le_bytes([planes[0][next], planes[1][next], planes[2][next], 0]);
        if *number >= end(at) {
            return Err(reader.corrupt("a map that does not exist"));
        }
    }
    Ok(())
}

fn read_form(reader: &mut Reader<'_>) -> Result<Form, LoadError> {
    let (vertices, triangles) = (reader.u32()?, reader.u32()?);
    let [terms, grid, directions, factors] = reader.array()?.map(u32::from);
    let contents = read_contents(reader)?;
    let [mean_width, surface_width, view_width] = reader
        .array::<6>()
        .map(|bytes| [0, 2, 4].map(|at| u32::from(u16::from_le_bytes([bytes[at], bytes[at + 1]]))))?;
    let widths = Widths { mean: mean_width, surface: surface_width, view: view_width };
    let [surface_reduce_log2] = reader.array()?;
    reader.end()?;
    let directions =
        Directions::from_number(directions).ok_or(reader.corrupt("unknown kind of directions"))?;
    let factors = Factors::from_number(factors).ok_or(reader.corrupt("unknown kind of factors"))?;
    let holds = |content| matches!(content, Content::Raw | Content::Bc1 | Content::Bc7);
    for (is_wrong, what) in [
        (vertices == 0 || vertices as usize > MAX_VERTICES, "no or too many vertices"),
        (triangles == 0 || triangles as usize > MAX_TRIANGLES, "no or too many triangles"),
        (terms > MAX_TERMS, "more than 8 terms"),
        (
            !(4..=64).contains(&grid) || !grid.is_multiple_of(4),
            "view maps of a side that is no multiple of 4 in 4..=64",
        ),
        (surface_reduce_log2 > 3, "surface maps halved more than three times"),
        (
            !contents.is_none_or(|contents| contents.into_iter().all(holds)),
            "content that holds no light-field maps",
        ),
    ] {
        if is_wrong {
            return Err(reader.corrupt(what));
        }
    }
    Ok(Form { vertices, triangles, terms, grid, directions, factors, contents, widths, surface_reduce_log2 })
}

/// Contents of the mean and of the maps; `None` where they are in blocks.
fn read_contents(reader: &mut Reader<'_>) -> Result<Option<[Content; 2]>, LoadError> {
    let mut numbers = reader.clone();
    if numbers.array::<2>()? == [IN_BLOCKS; 2] {
        *reader = numbers;
        return Ok(None);
    }
    Ok(Some([Content::read(reader)?, Content::read(reader)?]))
}

fn read_mesh(reader: &mut Reader<'_>, form: &Form, budget: &mut Budget) -> Result<MeshSection, LoadError> {
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
    let widest = sides.iter().copied().max().unwrap_or(0);
    if !form.widths.fit(widest, form.grid) {
        return Err(reader.corrupt("atlases of a width that holds no map"));
    }
    budget.take((SHARING_BYTES + 1) * u64::from(form.triangles))?;
    let own = Sharing::own(sides.iter().map(|&log2| Some(log2)), std::iter::empty());
    let sharing = read_sharing(reader, own, |at| sides[at])?;
    reader.end()?;
    Ok(MeshSection { mesh: Mesh { positions, triangles: indices }, sides_log2: sides, mean: sharing })
}

/// `count` words of which all lowest bytes come first, then all next ones.
fn read_words<'r>(
    reader: &mut Reader<'r>,
    count: usize,
) -> Result<impl Iterator<Item = u32> + use<'r>, LoadError> {
    let planes = [reader.bytes(count)?, reader.bytes(count)?, reader.bytes(count)?, reader.bytes(count)?];
    Ok((0..count).map(move |at| u32::from_le_bytes(planes.map(|plane| plane[at]))))
}

/// Planes that arrive in bands of rows; zeros where no band has come.
struct Bands {
    content: Content,
    size: (u32, u32),
    planes: Vec<Vec<u8>>,
    /// Rows that have come.
    rows: u32,
}

impl Bands {
    /// Books the planes and the texels that the CPU decoder makes of them.
    fn new(content: Content, size: (u32, u32), budget: &mut Budget) -> Result<Bands, LoadError> {
        take_texels(size, budget)?;
        let mut planes = Vec::new();
        for format in content.formats(PIXEL).0 {
            planes.push(budget.zeroed(format.bytes(size.0, size.1))?);
        }
        Ok(Bands { content, size, planes, rows: 0 })
    }

    /// Reads the next band of `rows` rows.
    fn read(
        &mut self,
        file: &Sections<'_>,
        id: [u8; 4],
        rows: u32,
        budget: &mut Budget,
    ) -> Result<(), LoadError> {
        let raw = file.read(id, budget)?;
        let mut reader = Reader::new(String4(id), &raw);
        for (plane, format) in self.planes.iter_mut().zip(self.content.formats(PIXEL).0) {
            let length = format.bytes(self.size.0, rows) as usize;
            let start = format.bytes(self.size.0, self.rows) as usize;
            let stored = reader.bytes(length)?;
            let band = plane.get_mut(start..start + length).ok_or(reader.corrupt("rows beyond the atlas"))?;
            band.copy_from_slice(stored);
            let step = format.block_bytes() as usize;
            if self.content == Content::Raw {
                for at in step..band.len() {
                    band[at] = band[at].wrapping_add(band[at - step]);
                }
            }
        }
        self.rows += rows;
        reader.end()
    }

    /// The whole.
    fn planes(self) -> Result<ContentPlanes, LoadError> {
        let whole = ContentPlanes::from_planes(self.content, PIXEL, self.size, self.planes);
        whole.ok_or(LoadError::Corrupt {
            section: String4(FORM_ID),
            offset: 0,
            what: "planes of another size",
        })
    }
}
