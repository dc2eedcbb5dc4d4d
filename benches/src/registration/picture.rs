//! Pictures of three channels in display values, and what a camera, the weather or time does to them.

use glam::{DMat3, DVec2, Vec3};
use rayon::prelude::*;
use texfold::core::image::{ColorSpace, Raster, to_u8};
use texfold_benches::report::Outcome;
use texfold_testkit::rng::Rng;

/// Radii of a Gaussian blur, in its deviations.
const CUT: f32 = 3.0;
/// Deviation of a Gaussian that leaves a third of the resolution: a box of three pixels twice, as drawing small and
/// enlarging does.
const THIRD_SIGMA: f32 = 1.4;

/// Values 0 to 1, row by row.
#[derive(Debug, Clone)]
pub(crate) struct Picture {
    pub(crate) width: usize,
    pub(crate) height: usize,
    pub(crate) data: Vec<Vec3>,
}

/// Where a homography leads a place.
pub(crate) fn moved(matrix: &DMat3, place: DVec2) -> DVec2 {
    let moved = *matrix * place.extend(1.0);
    moved.truncate() / moved.z
}

impl Picture {
    /// The middle of the image of that name, at most `side` texels wide and high.
    pub(crate) fn open(path: &std::path::Path, side: u32) -> Outcome<Picture> {
        let image = image::open(path)?.to_rgb8();
        let (width, height) = (image.width().min(side), image.height().min(side));
        let (left, top) = ((image.width() - width) / 2, (image.height() - height) / 2);
        let texel = |i: u32| {
            let texel = image.get_pixel(left + i % width, top + i / width).0;
            Vec3::from_array(texel.map(|byte| f32::from(byte) / 255.0))
        };
        let data = (0..width * height).map(texel).collect();
        Ok(Picture { width: width as usize, height: height as usize, data })
    }

    pub(crate) fn extent(&self) -> DVec2 {
        DVec2::new(self.width as f64, self.height as f64)
    }

    fn get(&self, x: i64, y: i64) -> Vec3 {
        let x = x.clamp(0, self.width as i64 - 1) as usize;
        let y = y.clamp(0, self.height as i64 - 1) as usize;
        self.data[y * self.width + x]
    }

    /// The value at a place in texels, between four of them.
    fn at(&self, place: DVec2) -> Vec3 {
        let place = place - 0.5;
        let corner = place.floor();
        let part = (place - corner).as_vec2();
        let (x, y) = (corner.x as i64, corner.y as i64);
        let upper = self.get(x, y).lerp(self.get(x + 1, y), part.x);
        let lower = self.get(x, y + 1).lerp(self.get(x + 1, y + 1), part.x);
        upper.lerp(lower, part.y)
    }

    /// A photograph of `size` pixels, each the mean of `grid` x `grid` places; `matrix` leads from its pixels to texels
    /// of this picture.
    pub(crate) fn view(&self, matrix: &DMat3, (width, height): (usize, usize), grid: usize) -> Picture {
        let value = |index: usize| {
            let corner = DVec2::new((index % width) as f64, (index / width) as f64);
            let mut sum = Vec3::ZERO;
            for k in 0..grid * grid {
                let part = (DVec2::new((k % grid) as f64, (k / grid) as f64) + 0.5) / grid as f64;
                sum += self.at(moved(matrix, corner + part));
            }
            sum / (grid * grid) as f32
        };
        let data = (0..width * height).into_par_iter().map(value).collect();
        Picture { width, height, data }
    }

    fn map(&mut self, change: impl Fn(usize, Vec3) -> Vec3) {
        for (index, value) in self.data.iter_mut().enumerate() {
            *value = change(index, *value).clamp(Vec3::ZERO, Vec3::ONE);
        }
    }

    /// Blurs to a third of the resolution.
    pub(crate) fn blur(&mut self) {
        let radius = (CUT * THIRD_SIGMA).ceil() as i64;
        let weight = |k: i64| (-0.5 * (k as f32 / THIRD_SIGMA).powi(2)).exp();
        let total: f32 = (-radius..=radius).map(weight).sum();
        for (dx, dy) in [(1, 0), (0, 1)] {
            let source = self.clone();
            let blurred = |index: usize, _| {
                let (x, y) = ((index % source.width) as i64, (index / source.width) as i64);
                let sum = |k: i64| source.get(x + k * dx, y + k * dy) * weight(k);
                (-radius..=radius).map(sum).sum::<Vec3>() / total
            };
            self.map(blurred);
        }
    }

    /// Adds noise of the deviation `sigma`.
    pub(crate) fn noise(&mut self, sigma: f64, rng: &mut Rng) {
        let mut normal = || ((0..4).map(|_| rng.unit() - 0.5).sum::<f64>() * 3f64.sqrt() * sigma) as f32;
        for value in &mut self.data {
            *value = (*value + Vec3::new(normal(), normal(), normal())).clamp(Vec3::ZERO, Vec3::ONE);
        }
    }

    /// Another exposure and contrast, and another curve.
    pub(crate) fn expose(&mut self, rng: &mut Rng) {
        let (gain, contrast, gamma) = (rng.between(0.5, 1.6), rng.between(0.6, 1.3), rng.between(0.7, 1.4));
        self.map(|_, value| {
            let curved = (value * gain as f32).clamp(Vec3::ZERO, Vec3::ONE).powf(gamma as f32);
            (curved - 0.5) * contrast as f32 + 0.5
        });
    }

    /// Haze of 30 to 70 % that thickens in one direction.
    pub(crate) fn haze(&mut self, rng: &mut Rng) {
        let (from, to) = (rng.between(0.3, 0.7) as f32, rng.between(0.3, 0.7) as f32);
        let turn = DVec2::from_angle(rng.between(0.0, std::f64::consts::TAU));
        let (extent, width) = (self.extent(), self.width);
        self.map(|index, value| {
            let place = DVec2::new((index % width) as f64, (index / width) as f64) / extent - 0.5;
            let share = (turn.dot(place) + 0.5).clamp(0.0, 1.0) as f32;
            value.lerp(Vec3::new(0.82, 0.85, 0.9), from + (to - from) * share)
        });
    }

    /// Fades the colours: nearly gray, yellowish, of less contrast.
    pub(crate) fn fade(&mut self, rng: &mut Rng) {
        let (keep, contrast) = (rng.between(0.0, 0.4) as f32, rng.between(0.4, 0.8) as f32);
        let paper = Vec3::new(0.93, 0.87, 0.72);
        self.map(|_, value| {
            let gray = Vec3::splat(value.dot(Vec3::new(0.3, 0.6, 0.1)));
            paper * (1.0 - contrast) + gray.lerp(value, keep) * paper * contrast
        });
    }

    /// Lays an ellipse of another picture over this one: its middle and radii in pixels.
    pub(crate) fn cover(&mut self, other: &Picture, middle: DVec2, radii: DVec2) {
        let width = self.width;
        self.map(|index, value| {
            let place = DVec2::new((index % width) as f64, (index / width) as f64) + 0.5;
            let inside = ((place - middle) / radii).length() < 1.0;
            if inside { other.at(place - middle + 0.5 * other.extent()) } else { value }
        });
    }

    /// What is left of it behind JPEG of that quality, 1 to 100.
    pub(crate) fn jpeg(&mut self, quality: u8) -> Outcome<()> {
        let mut bytes = Vec::new();
        let encoder = jpeg_encoder::Encoder::new(&mut bytes, quality);
        encoder.encode(&self.bytes(), self.width as u16, self.height as u16, jpeg_encoder::ColorType::Rgb)?;
        let read = image::load_from_memory(&bytes)?.to_rgb8();
        self.data = read
            .pixels()
            .map(|texel| Vec3::from_array(texel.0.map(|byte| f32::from(byte) / 255.0)))
            .collect();
        Ok(())
    }

    fn bytes(&self) -> Vec<u8> {
        self.data.iter().flat_map(|value| value.to_array().map(to_u8)).collect()
    }

    pub(crate) fn raster(&self) -> Outcome<Raster> {
        Ok(Raster::from_u8(self.width as u32, self.height as u32, 3, ColorSpace::Srgb, &self.bytes())?)
    }

    pub(crate) fn save(&self, path: &std::path::Path) -> Outcome<()> {
        let (width, height) = (self.width as u32, self.height as u32);
        Ok(image::save_buffer(path, &self.bytes(), width, height, image::ColorType::Rgb8)?)
    }

    /// Share of `fields` x `fields` fields whose gray values deviate by more than `least`, of those whose middle
    /// `within` names.
    pub(crate) fn textured(&self, fields: usize, least: f32, within: impl Fn(DVec2) -> bool) -> f64 {
        let (mut shown, mut all) = (0, 0);
        for (row, column) in (0..fields).flat_map(|row| (0..fields).map(move |column| (row, column))) {
            let (left, top) = (column * self.width / fields, row * self.height / fields);
            let (right, bottom) = ((column + 1) * self.width / fields, (row + 1) * self.height / fields);
            if !within(DVec2::new((left + right) as f64, (top + bottom) as f64) * 0.5) {
                continue;
            }
            let places = (top..bottom).flat_map(|y| (left..right).map(move |x| (x, y)));
            let values: Vec<f32> =
                places.map(|(x, y)| self.data[y * self.width + x].element_sum() / 3.0).collect();
            let mean = values.iter().sum::<f32>() / values.len().max(1) as f32;
            let spread = values.iter().map(|value| (value - mean).powi(2)).sum::<f32>();
            all += 1;
            shown += usize::from((spread / values.len().max(1) as f32).sqrt() > least);
        }
        f64::from(shown as u32) / f64::from(all.max(1) as u32)
    }
}
