//! Materials: each map beside ASTC at equal bits; all maps as one texture beside maps that share the bits evenly; and what is seen of them
//! under three lights.
//!
//! `cargo run --release -p texfold-benches --bin materials -- [FOLDER [OUT]]`; without a folder, that of the materials of the data folder. What is seen is
//! written to OUT. ASTC is
//! encoded by the program `astcenc` (`-thorough`, all maps linear), where it is installed. Maps are found by the ends of their files' names.

use std::error::Error;
use std::path::{Path, PathBuf};

use glam::{Vec3, Vec4Swizzles};
use texfold::core::image::{linear_to_srgb, srgb_to_linear};
use texfold::core::metric::{SquaredError, color_error, decode_image};
use texfold::{
    ColorSpace, Encoded, Goal, ImageSet, Job, MapKind, Metric, PixelInfo, Raster,
    core::{Encoder, Image2d},
    dct::{Dct, DctParams},
};
use texfold_benches::report::{Outcome, Table};
use texfold_cli::{astc_by_astcenc, degrees_of, materials_of, ssimulacra2};

/// Sides of ASTC blocks that maps are compared with.
const ASTC: [u32; 3] = [12, 10, 8];
/// Bits a texel of whole materials.
const TOTALS: [f64; 2] = [3.0, 5.0];
/// Side of the ASTC blocks whose lit surface is compared.
const LIT_ASTC: u32 = 6;

fn main() -> Outcome<()> {
    let given = std::env::args().nth(1).map(PathBuf::from);
    let folder = given.or_else(|| texfold_testkit::data_dir("materials").map(|data| data.join("pbr")));
    let out = std::env::args().nth(2).map(PathBuf::from);
    out.iter().try_for_each(std::fs::create_dir_all)?;
    let materials = materials_of(&folder.ok_or("name a folder of materials")?)
        .map_err(|error| error as Box<dyn Error>)?;
    let mut alone = Table::new(&["map", "bits", "dB", "ASTC dB", "degrees", "ASTC degrees"]);
    let mut whole = Table::new(&[
        "material",
        "bits",
        "form",
        "dB of all maps",
        "dB by map",
        "degrees",
        "lit SSIMULACRA2",
    ]);
    for (name, set) in &materials {
        eprintln!("{name}");
        maps_alone(set, &mut alone)?;
        if set.maps().len() > 1 {
            whole_material(name, set, out.as_deref(), &mut whole)?;
        }
    }
    Ok(())
}

/// Each map beside ASTC of as many bits.
fn maps_alone(set: &ImageSet, table: &mut Table) -> Outcome<()> {
    for (map, image) in set.maps().iter().zip(set.images()) {
        for side in ASTC {
            let Some((rival, bits)) = astc(image, side)? else { continue };
            let bpp = bits as f64 / image.size().texels() as f64;
            let ours = alone(image, bpp)?;
            let degrees = |decoded: &Raster| angle(degrees_of(image, decoded));
            table.row(vec![
                map.name.clone(),
                format!("{bpp:.2}"),
                format!("{:.2}", color_error(image, &ours).psnr()),
                format!("{:.2}", color_error(image, &rival).psnr()),
                degrees(&ours),
                degrees(&rival),
            ]);
        }
    }
    Ok(())
}

/// All maps within totals of bits: as one texture, with even shares, and by ASTC.
fn whole_material(name: &str, set: &ImageSet, out: Option<&Path>, table: &mut Table) -> Outcome<()> {
    let lit = surface(set, set.images());
    let write = |form: &str, seen: Option<&Raster>| match (out, seen) {
        (Some(out), Some(seen)) => {
            let size = seen.size();
            let path = out.join(format!("{name}, {form}.png"));
            image::save_buffer(path, &seen.to_bytes(), size.width, size.height, image::ColorType::Rgb8)
        }
        _ => Ok(()),
    };
    write("source", lit.as_ref())?;
    let mut row = |form: &str, bits: f64, decoded: &[Raster]| -> Outcome<()> {
        let errors: Vec<SquaredError> =
            set.images().iter().zip(decoded).map(|(image, decoded)| color_error(image, decoded)).collect();
        let all = errors.iter().fold(SquaredError::default(), |sum, &error| sum + error);
        let by_map: Vec<String> = errors.iter().map(|error| format!("{:.1}", error.psnr())).collect();
        let degrees =
            set.images().iter().zip(decoded).find_map(|(image, decoded)| degrees_of(image, decoded));
        let seen = surface(set, decoded);
        write(&format!("{form} at {bits:.1} bits"), seen.as_ref())?;
        let score = lit.as_ref().zip(seen.as_ref()).and_then(|(lit, seen)| ssimulacra2(lit, seen));
        table.row(vec![
            name.to_owned(),
            format!("{bits:.2}"),
            form.to_owned(),
            format!("{:.2}", all.psnr()),
            by_map.join(" "),
            angle(degrees),
            score.map_or("-".to_owned(), |score| format!("{score:.1}")),
        ]);
        Ok(())
    };
    let texels = set.texel_count() as f64;
    for total in TOTALS {
        for (form, metric) in [("one texture", None), ("one texture, psnr", Some(Metric::Psnr))] {
            let params = DctParams::default().with_goal(Goal::Bpp(total)).with_metric(metric);
            let texture = Dct::encode(set, &params, &mut Job::default())?;
            row(form, texture.memory().goal as f64 / texels, &decoded(&texture)?)?;
        }
        let even = set.images().iter().map(|image| {
            let share = total / set.images().len() as f64 * texels / image.size().texels() as f64;
            alone(image, share)
        });
        row("even shares, psnr", total, &even.collect::<Outcome<Vec<_>>>()?)?;
    }
    let rivals = set.images().iter().map(|image| astc(image, LIT_ASTC));
    let rivals = rivals.collect::<Outcome<Option<Vec<_>>>>()?;
    if let Some(rivals) = rivals {
        let bits = rivals.iter().map(|(_, bits)| bits).sum::<u64>() as f64 / texels;
        let decoded: Vec<Raster> = rivals.into_iter().map(|(decoded, _)| decoded).collect();
        row("ASTC 6x6 of each", bits, &decoded)?;
    }
    Ok(())
}

fn astc(image: &Raster, side: u32) -> Outcome<Option<(Raster, u64)>> {
    astc_by_astcenc(image, side, "-thorough").map_err(|error| error as Box<dyn Error>)
}

fn angle(degrees: Option<f64>) -> String {
    degrees.map_or("-".to_owned(), |degrees| format!("{degrees:.2}"))
}

/// A map by itself within so many bits a texel, decoded; errors count alike.
fn alone(image: &Raster, bpp: f64) -> Outcome<Raster> {
    let params = DctParams::default().with_goal(Goal::Bpp(bpp)).with_metric(Metric::Psnr);
    let texture = Dct::encode(&ImageSet::single(image.clone()), &params, &mut Job::default())?;
    decoded(&texture)?.pop().ok_or("no image".into())
}

fn decoded(texture: &dyn Encoded<Domain = Image2d>) -> Outcome<Vec<Raster>> {
    let images = 0..texture.layout().images.len() as u32;
    images.map(|image| decode_image(texture, image, 0).ok_or("no image".into())).collect()
}

/// Directions to the lights, and their colours.
const LIGHTS: [([f32; 3], [f32; 3]); 3] = [
    ([0.6, 0.3, 0.75], [2.2, 2.0, 1.8]),
    ([-0.7, 0.4, 0.6], [0.7, 0.9, 1.2]),
    ([0.1, -0.9, 0.4], [0.5, 0.4, 0.4]),
];
const AMBIENT: f32 = 0.15;

/// The surface of a material, seen from above under [`LIGHTS`] with the reflection of Trowbridge and Reitz (GGX); `None` without colours.
fn surface(set: &ImageSet, images: &[Raster]) -> Option<Raster> {
    let of_kind = |kind| set.maps().iter().position(|map| map.kind == kind).map(|index| &images[index]);
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
