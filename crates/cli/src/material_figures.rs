//! Materials: what is seen of all maps together.

use glam::{Vec3, Vec4Swizzles};
use serde::{Deserialize, Serialize};
use texfold_core::image::{ColorSpace, ImageSet, MapKind, PixelInfo, Raster, linear_to_srgb, srgb_to_linear};

use crate::normals::degrees_of;
use crate::perceptual::ssimulacra2;

/// Directions to the lights, and their colours.
const LIGHTS: [([f32; 3], [f32; 3]); 3] = [
    ([0.6, 0.3, 0.75], [2.2, 2.0, 1.8]),
    ([-0.7, 0.4, 0.6], [0.7, 0.9, 1.2]),
    ([0.1, -0.9, 0.4], [0.5, 0.4, 0.4]),
];
const AMBIENT: f32 = 0.15;

/// How close a decoded material comes.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub(crate) struct MaterialFigures {
    /// Mean angle in degrees between the normals of the first map of normals; `None` where there is none of three channels.
    pub(crate) degrees: Option<f64>,
    /// SSIMULACRA2 of the lit surface; `None` without a map of colours beside others.
    #[serde(rename = "lit_ssimulacra2")]
    pub(crate) lit: Option<f64>,
}

impl MaterialFigures {
    /// Compares the images of a set with what they are decoded to.
    pub(crate) fn of(set: &ImageSet, decoded: &[&Raster]) -> MaterialFigures {
        let sources: Vec<&Raster> = set.images().iter().collect();
        let degrees = sources.iter().zip(decoded).find_map(|(source, decoded)| degrees_of(source, decoded));
        let lit = || ssimulacra2(&surface(set, &sources)?, &surface(set, decoded)?);
        MaterialFigures { degrees, lit: if sources.len() > 1 { lit() } else { None } }
    }
}

/// The surface of a material, seen from above under [`LIGHTS`] with the reflection of Trowbridge and Reitz (GGX); `None` without colours.
fn surface(set: &ImageSet, images: &[&Raster]) -> Option<Raster> {
    let of_kind = |kind| set.maps().iter().position(|map| map.kind == kind).map(|index| images[index]);
    let color = of_kind(MapKind::BaseColor)?;
    let normals = of_kind(MapKind::Normal);
    let packed = of_kind(MapKind::OcclusionRoughnessMetalness);
    let size = color.size();
    let texels = (0..size.height).flat_map(|y| (0..size.width).map(move |x| (x, y)));
    let data = texels.flat_map(|(x, y)| {
        let at = |image: &Raster| {
            let own = image.size();
            image.texel(x * own.width / size.width, y * own.height / size.height)
        };
        let value = |kind, channel: usize, usual: f32| {
            let lone = of_kind(kind).map(|image| at(image).x);
            lone.or_else(|| packed.map(|image| at(image)[channel])).unwrap_or(usual)
        };
        let material = Surface {
            color: at(color).xyz().map(srgb_to_linear),
            normal: normals.map_or(Vec3::Z, |image| (2.0 * at(image).xyz() - 1.0).normalize_or(Vec3::Z)),
            occlusion: value(MapKind::Occlusion, 0, 1.0),
            roughness: value(MapKind::Roughness, 1, 0.5),
            metalness: value(MapKind::Metalness, 2, 0.0),
        };
        material.lit().map(|value| linear_to_srgb(value.clamp(0.0, 1.0))).to_array()
    });
    let info = PixelInfo { channels: 3, color: ColorSpace::Srgb, ..PixelInfo::default() };
    Raster::new(size.width, size.height, info, data.collect()).ok()
}

/// A place on a surface.
struct Surface {
    color: Vec3,
    normal: Vec3,
    occlusion: f32,
    roughness: f32,
    metalness: f32,
}

impl Surface {
    /// Light towards a viewer above.
    fn lit(&self) -> Vec3 {
        let (view, normal) = (Vec3::Z, self.normal);
        let alpha = (self.roughness * self.roughness).max(0.002);
        let (diffuse, base) =
            (self.color * (1.0 - self.metalness), Vec3::splat(0.04).lerp(self.color, self.metalness));
        let facing = normal.dot(view).max(1e-3);
        let mut sum = AMBIENT * self.occlusion * (diffuse + base);
        for (direction, light) in LIGHTS {
            let direction = Vec3::from(direction).normalize();
            let lit = normal.dot(direction);
            if lit <= 0.0 {
                continue;
            }
            let half = (direction + view).normalize();
            let (across, square) = (normal.dot(half), alpha * alpha);
            let spread = across * across * (square - 1.0) + 1.0;
            let facets = square / (std::f32::consts::PI * spread * spread);
            let k = (self.roughness + 1.0).powi(2) / 8.0;
            let seen = |cosine: f32| cosine / (cosine * (1.0 - k) + k);
            let fresnel = base + (Vec3::ONE - base) * (1.0 - view.dot(half)).powi(5);
            let mirrored = fresnel * (facets * seen(lit) * seen(facing) / (4.0 * lit * facing));
            let scattered = diffuse * (Vec3::ONE - fresnel) / std::f32::consts::PI;
            sum += (mirrored + scattered) * Vec3::from(light) * lit;
        }
        sum
    }
}
