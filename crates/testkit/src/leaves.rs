//! A surface with detail at every scale, seen through any homography: discs of all sizes that cover each other ("dead leaves",
//! Lee, Mumford, Huang, "Occlusion models for natural images", IJCV 2001). Views of it are exact, so registration can be held
//! against the truth.

use glam::{DMat3, DVec2};
use texfold_core::Texel;
use texfold_core::image::{Alpha, ColorSpace, Depth, PixelInfo, Raster};
use texfold_core::rng::Rng;

/// Fields a side in which discs are looked up.
const FIELDS: usize = 64;
/// Radii of the largest and the smallest disc; the surface reaches from 0 to 1.
const RADII: (f64, f64) = (0.12, 0.0008);

/// Discs on the square from 0 to 1, uppermost first.
#[derive(Debug, Clone)]
pub struct Leaves {
    discs: Vec<Disc>,
    fields: Vec<Vec<u32>>,
}

#[derive(Debug, Clone, Copy)]
struct Disc {
    middle: DVec2,
    radius: f64,
    colour: Texel,
}

impl Leaves {
    /// `count` discs.
    #[must_use]
    pub fn new(seed: u64, count: usize) -> Leaves {
        let mut rng = Rng::new(seed);
        let (large, small) = (RADII.0.powi(-2), RADII.1.powi(-2));
        let disc = |_| Disc {
            middle: DVec2::new(rng.between(-0.05, 1.05), rng.between(-0.05, 1.05)),
            // Density falls with the cube of the radius: the same at all scales.
            radius: rng.between(large, small).powf(-0.5),
            colour: {
                let gray = rng.unit();
                let tint = [0; 3].map(|_| (0.8 * gray + 0.2 * rng.unit()) as f32);
                Texel::new(tint[0], tint[1], tint[2], 1.0)
            },
        };
        let discs: Vec<Disc> = (0..count).map(disc).collect();
        let mut fields = vec![Vec::new(); FIELDS * FIELDS];
        for (index, disc) in (0..).zip(&discs) {
            let field = |value: f64| ((value * FIELDS as f64) as usize).min(FIELDS - 1);
            let (low, high) = (disc.middle - disc.radius, disc.middle + disc.radius);
            for y in field(low.y)..=field(high.y) {
                for x in field(low.x)..=field(high.x) {
                    fields[y * FIELDS + x].push(index);
                }
            }
        }
        Leaves { discs, fields }
    }

    /// The colour of a place; gray where no disc is.
    #[must_use]
    pub fn colour(&self, place: DVec2) -> Texel {
        if place.cmplt(DVec2::ZERO).any() || place.cmpgt(DVec2::ONE).any() {
            return Texel::new(0.5, 0.5, 0.5, 1.0);
        }
        let field = (place * FIELDS as f64).as_uvec2().min(glam::UVec2::splat(FIELDS as u32 - 1));
        let list = &self.fields[field.y as usize * FIELDS + field.x as usize];
        let covers = |index: &&u32| {
            let disc = &self.discs[**index as usize];
            (disc.middle - place).length_squared() < disc.radius * disc.radius
        };
        list.iter()
            .find(covers)
            .map_or(Texel::new(0.5, 0.5, 0.5, 1.0), |&index| self.discs[index as usize].colour)
    }

    /// What an image of `size` pixels shows whose texture coordinates `matrix` leads to from the surface's: each pixel the mean of
    /// `grid` x `grid` places.
    #[must_use]
    pub fn view(&self, matrix: &DMat3, size: (u32, u32), grid: u32) -> Vec<Texel> {
        let inverse = matrix.inverse();
        let pixel = |index: u32| {
            let (x, y) = (f64::from(index % size.0), f64::from(index / size.0));
            let place = |k: u32| {
                let inside = DVec2::new(f64::from(k % grid), f64::from(k / grid)) + 0.5;
                let at =
                    (DVec2::new(x, y) + inside / f64::from(grid)) / DVec2::new(size.0.into(), size.1.into());
                let moved = inverse * at.extend(1.0);
                self.colour(moved.truncate() / moved.z)
            };
            (0..grid * grid).map(place).sum::<Texel>() / (grid * grid) as f32
        };
        (0..size.0 * size.1).map(pixel).collect()
    }
}

/// How a photograph differs from what is there.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lens {
    /// What values are multiplied by.
    pub exposure: f64,
    /// Deviation of the noise of a pixel, of a range of 1.
    pub noise: f64,
    /// Start of the noise.
    pub seed: u64,
}

/// An image of `size` pixels, 8 bits, RGB.
///
/// # Panics
/// Where there are fewer texels than pixels.
#[must_use]
#[expect(clippy::panic, reason = "a test without its image must fail")]
pub fn photograph(texels: &[Texel], size: (u32, u32), lens: Lens) -> Raster {
    let mut rng = Rng::new(lens.seed);
    let mut step = |value: f32| {
        // A sum of four has nearly a normal distribution.
        let noise = (0..4).map(|_| rng.unit() - 0.5).sum::<f64>() * 1.732 * lens.noise;
        let value = (f64::from(value) * lens.exposure + noise).clamp(0.0, 1.0);
        (value * 255.0).round() as f32 / 255.0
    };
    let data = texels.iter().flat_map(|texel| [step(texel.x), step(texel.y), step(texel.z)]).collect();
    let info = PixelInfo { channels: 3, depth: Depth::Eight, color: ColorSpace::Srgb, alpha: Alpha::Opaque };
    match Raster::new(size.0, size.1, info, data) {
        Ok(raster) => raster,
        Err(error) => panic!("{error}"),
    }
}

/// A matrix to an image around `middle` of the surface, `zoom` times as close as the whole, turned, and slanted.
#[must_use]
pub fn close_up(middle: DVec2, zoom: f64, turn: f64, slant: DVec2) -> DMat3 {
    let mut slanted = DMat3::IDENTITY;
    (slanted.x_axis.z, slanted.y_axis.z) = (slant.x, slant.y);
    DMat3::from_translation(DVec2::splat(0.5))
        * slanted
        * DMat3::from_scale_angle_translation(DVec2::splat(zoom), turn, DVec2::ZERO)
        * DMat3::from_translation(-middle)
}
