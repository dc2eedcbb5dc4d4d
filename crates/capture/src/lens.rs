//! Lenses of cameras, and the pinhole images of lenses that distort.
//!
//! *Not done*: panoramic lenses, those of COLMAP's FOV and THIN_PRISM_FISHEYE and the rational model; a file that has one is refused.

use glam::{UVec2, Vec2, Vec4};
use rayon::prelude::*;
use serde::Deserialize;
use texfold::core::{Camera, Photograph};

/// Coefficients below this move no pixel of an image that a texture can hold.
const LEAST_DISTORTION: f32 = 1e-7;
/// Camera models that project as a pinhole but for [`Distortion`], by nerfstudio's, COLMAP's and Metashape's names.
const MODELS: [&str; 8] =
    ["PERSPECTIVE", "FRAME", "PINHOLE", "SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV", "FULL_OPENCV"];
/// Those that project by the angle from the axis.
const FISHEYES: [&str; 4] = ["FISHEYE", "OPENCV_FISHEYE", "SIMPLE_RADIAL_FISHEYE", "RADIAL_FISHEYE"];
/// Steps from the axis to the farthest pixel in which the sign of the radial slope is looked at.
const STEPS: u32 = 256;

/// Lens and image size of a camera or of a file of cameras.
#[derive(Debug, Clone, Default, Deserialize)]
pub(super) struct Lens {
    pub(super) w: Option<f32>,
    pub(super) h: Option<f32>,
    pub(super) fl_x: Option<f32>,
    pub(super) fl_y: Option<f32>,
    pub(super) cx: Option<f32>,
    pub(super) cy: Option<f32>,
    pub(super) camera_angle_x: Option<f32>,
    pub(super) camera_model: Option<String>,
    pub(super) is_fisheye: Option<bool>,
    pub(super) k1: Option<f32>,
    pub(super) k2: Option<f32>,
    pub(super) k3: Option<f32>,
    pub(super) k4: Option<f32>,
    pub(super) p1: Option<f32>,
    pub(super) p2: Option<f32>,
}

/// Distortion by Brown and Conrady, as OpenCV's first five coefficients: from a ray's place in the plane at distance 1 to the place where
/// the lens draws it. Of a fisheye lens (Kannala and Brandt, as OpenCV has it) by the angle from the axis in place of the radius.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Distortion {
    /// Of the second, fourth, sixth and eighth power of the radius.
    radial: [f32; 4],
    tangential: [f32; 2],
    is_fisheye: bool,
}

impl Lens {
    /// With the values of `other` where this one has none.
    pub(super) fn or(self, other: &Lens) -> Lens {
        Lens {
            w: self.w.or(other.w),
            h: self.h.or(other.h),
            fl_x: self.fl_x.or(other.fl_x),
            fl_y: self.fl_y.or(other.fl_y),
            cx: self.cx.or(other.cx),
            cy: self.cy.or(other.cy),
            camera_angle_x: self.camera_angle_x.or(other.camera_angle_x),
            camera_model: self.camera_model.or_else(|| other.camera_model.clone()),
            is_fisheye: self.is_fisheye.or(other.is_fisheye),
            k1: self.k1.or(other.k1),
            k2: self.k2.or(other.k2),
            k3: self.k3.or(other.k3),
            k4: self.k4.or(other.k4),
            p1: self.p1.or(other.p1),
            p2: self.p2.or(other.p2),
        }
    }

    /// Its distortion, `None` where it has none.
    ///
    /// # Errors
    /// A phrase for a lens of another model, or a coefficient that is no number.
    pub(super) fn distortion(&self) -> Result<Option<Distortion>, &'static str> {
        let of = |value: Option<f32>| value.unwrap_or(0.0);
        let radial = [self.k1, self.k2, self.k3, self.k4].map(of);
        let tangential = [self.p1, self.p2].map(of);
        let mut all = radial.into_iter().chain(tangential);
        if !all.clone().all(f32::is_finite) {
            return Err("has a lens coefficient that is not a finite number");
        }
        let model = self.camera_model.as_ref().map(|name| name.to_uppercase());
        let is_one_of = |names: &[&str]| model.as_ref().is_some_and(|name| names.contains(&name.as_str()));
        let is_fisheye = self.is_fisheye == Some(true) || is_one_of(&FISHEYES);
        if !is_fisheye && model.is_some() && !is_one_of(&MODELS) {
            return Err(
                "has a lens that is neither a pinhole with k1 to k4, p1 and p2 nor a fisheye: undistort the images first",
            );
        }
        let distorts = is_fisheye || all.any(|value| value.abs() > LEAST_DISTORTION);
        Ok(distorts.then_some(Distortion { radial, tangential, is_fisheye }))
    }
}

impl Distortion {
    /// The place where the lens draws what a pinhole draws at `at`, both in units of the focal length from the axis.
    fn distorted(self, at: Vec2) -> Vec2 {
        let radius = at.length();
        let at = if self.is_fisheye && radius > 0.0 { at * (radius.atan() / radius) } else { at };
        let square = at.length_squared();
        let [first, second, third, fourth] = self.radial;
        let scale = 1.0 + square * (first + square * (second + square * (third + square * fourth)));
        let [down, across] = self.tangential;
        let shift = 2.0 * at.x * at.y * Vec2::new(down, across);
        at * scale + shift + (Vec2::splat(square) + 2.0 * at * at) * Vec2::new(across, down)
    }

    /// The radius up to which the lens draws farther rays farther out: beyond it a polynomial folds back, and means nothing.
    fn unfolded(self, most: f32) -> f32 {
        let [first, second, third, fourth] = self.radial;
        let rises = |radius: f32| {
            let square = if self.is_fisheye { radius.atan() } else { radius }.powi(2);
            let last = 7.0 * third + square * 9.0 * fourth;
            1.0 + square * (3.0 * first + square * (5.0 * second + square * last)) > 0.0
        };
        let radius = |step: u32| most * step as f32 / STEPS as f32;
        (0..=STEPS).map(radius).take_while(|&radius| rises(radius)).last().unwrap_or(0.0)
    }

    /// The image of a pinhole camera with the focal length and centre of the lens, bilinear; pixels that the photograph does not have
    /// are unseen.
    pub(super) fn undistorted(self, photo: &Photograph) -> Photograph {
        let camera = photo.camera;
        let place = |x, y| (Vec2::new(x, y) - camera.centre) / camera.focal;
        let (width, height) = (camera.width as f32, camera.height as f32);
        let corners = [(0.0, 0.0), (width, 0.0), (0.0, height), (width, height)];
        let most = corners.map(|(x, y)| place(x, y).length()).into_iter().fold(0.0, f32::max);
        let unfolded = self.unfolded(most);
        let pixel = |index: u32| {
            let at = place((index % camera.width) as f32 + 0.5, (index / camera.width) as f32 + 0.5);
            if at.length() > unfolded {
                return [0; 4];
            }
            bilinear(photo, camera.centre + camera.focal * self.distorted(at))
        };
        let pixels = (0..camera.width * camera.height).into_par_iter().map(pixel).collect();
        Photograph { camera, pixels }
    }
}

/// The photograph at a place in pixels from the upper left corner; unseen outside of it and where a pixel around is.
fn bilinear(photo: &Photograph, place: Vec2) -> [u8; 4] {
    let Camera { width, height, .. } = photo.camera;
    let at = place - 0.5;
    // Half a pixel at each border has one neighbour only.
    let inside =
        at.cmpge(Vec2::splat(-0.5)).all() && at.cmple(Vec2::new(width as f32, height as f32) - 0.5).all();
    if !inside {
        return [0; 4];
    }
    let last = UVec2::new(width, height) - 1;
    let at = at.clamp(Vec2::ZERO, last.as_vec2());
    let (low, share) = (at.as_uvec2(), at.fract());
    let tap = |dx, dy| {
        let UVec2 { x, y } = (low + UVec2::new(dx, dy)).min(last);
        photo.pixels[(y * width + x) as usize]
    };
    let taps = [tap(0, 0), tap(1, 0), tap(0, 1), tap(1, 1)];
    let [near, right, below, far] = taps.map(|texel| Vec4::from(texel.map(f32::from)));
    let mixed = near.lerp(right, share.x).lerp(below.lerp(far, share.x), share.y);
    let [r, g, b, _] = mixed.round().to_array().map(|value| value as u8);
    [r, g, b, taps.iter().fold(255, |least, texel| least.min(texel[3]))]
}

#[cfg(test)]
mod tests {
    use glam::Mat4;

    use super::*;

    fn lens(json: &str) -> Lens {
        serde_json::from_str(json).unwrap()
    }

    /// A smooth picture over rays, in units of the focal length from the axis.
    fn scene(at: Vec2) -> [u8; 4] {
        let wave = |phase: f32| 127.5 + 100.0 * (9.0 * at.x + phase).sin() * (7.0 * at.y - phase).cos();
        [wave(0.0), wave(1.0), wave(2.0), 255.0].map(|value| value.round() as u8)
    }

    /// The ray that the lens draws at a place, by Newton's method with numeric slopes.
    fn ray(distortion: Distortion, place: Vec2) -> Vec2 {
        let mut at = place;
        for _ in 0..20 {
            let step = 1e-3;
            let here = distortion.distorted(at) - place;
            let x = (distortion.distorted(at + step * Vec2::X) - distortion.distorted(at)) / step;
            let y = (distortion.distorted(at + step * Vec2::Y) - distortion.distorted(at)) / step;
            at -= glam::Mat2::from_cols(x, y).inverse() * here;
        }
        at
    }

    fn camera(width: u32, height: u32) -> Camera {
        let (focal, centre) =
            (Vec2::new(200.0, 190.0), Vec2::new(0.52, 0.47) * Vec2::new(width as f32, height as f32));
        Camera { width, height, focal, centre, to_world: Mat4::IDENTITY }
    }

    fn picture(camera: Camera, pixel: impl Fn(Vec2) -> [u8; 4]) -> Photograph {
        let place = |index: u32| {
            let at = Vec2::new((index % camera.width) as f32, (index / camera.width) as f32) + 0.5;
            pixel((at - camera.centre) / camera.focal)
        };
        Photograph { camera, pixels: (0..camera.width * camera.height).map(place).collect() }
    }

    /// The formula of OpenCV's manual, computed by hand.
    #[test]
    fn places_are_those_of_the_formula() {
        let found = lens(r#"{"k1": -0.2, "k2": 0.05, "k3": 0.01, "p1": 0.01, "p2": -0.02}"#);
        let place = found.distortion().unwrap().unwrap().distorted(Vec2::new(0.3, -0.2));
        assert!(place.distance(Vec2::new(0.285_060_1, -0.190_473_4)) < 1e-6, "{place}");
        // 45 degrees from the axis: pi / 4 (1 + 0.1 pi^2 / 16 + 0.02 pi^8 / 65536).
        let found = lens(r#"{"k1": 0.1, "k4": 0.02, "camera_model": "OPENCV_FISHEYE"}"#);
        let place = found.distortion().unwrap().unwrap().distorted(Vec2::new(0.6, -0.8));
        assert!(place.distance(0.836_119_7 * Vec2::new(0.6, -0.8)) < 1e-6, "{place}");
    }

    #[test]
    fn a_distorted_photograph_becomes_that_of_a_pinhole() {
        let camera = camera(240, 180);
        for found in [
            r#"{"k1": -0.2, "k2": 0.05, "p1": 0.01, "p2": -0.02}"#,
            r#"{"k1": 0.15, "k3": 0.02, "k4": 0.01, "camera_model": "OPENCV"}"#,
            r#"{"is_fisheye": true}"#,
            r#"{"k1": 0.1, "k2": -0.05, "k4": 0.01, "camera_model": "OPENCV_FISHEYE"}"#,
        ] {
            let distortion = lens(found).distortion().unwrap().unwrap();
            let taken = picture(camera, |place| scene(ray(distortion, place)));
            let mended = distortion.undistorted(&taken);
            let wanted = picture(camera, scene);
            let error = |a: &Photograph| {
                let seen = || a.pixels.iter().zip(&wanted.pixels).filter(|(pixel, _)| pixel[3] > 0);
                let worst = seen().map(|(a, b)| (0..3).map(|c| a[c].abs_diff(b[c])).max().unwrap()).max();
                (worst.unwrap(), seen().count())
            };
            let (worst, count) = error(&mended);
            assert!(worst <= 2, "{found}: {worst}");
            assert!(count * 10 > mended.pixels.len() * 8, "{found}: {count} seen");
            assert!(error(&taken).0 > 20, "{found}");
        }
    }

    #[test]
    fn pixels_that_the_photograph_lacks_are_unseen() {
        let camera = camera(240, 180);
        let white = picture(camera, |_| [255; 4]);
        let seen =
            |found: &str, photo: &Photograph| lens(found).distortion().unwrap().unwrap().undistorted(photo);
        // Pincushion: corners of the pinhole image are outside of the photograph.
        let outside = seen(r#"{"k1": 0.3}"#, &white);
        assert_eq!((outside.pixels[0], outside.pixels[90 * 240 + 120]), ([0; 4], [255; 4]));
        // Beyond a radius of 0.41 this lens folds back into the photograph.
        let folded = seen(r#"{"k1": -2.0}"#, &white);
        assert_eq!((folded.pixels[0], folded.pixels[90 * 240 + 120]), ([0; 4], [255; 4]));
        let mut masked = white.clone();
        masked.pixels[90 * 240 + 120] = [9, 9, 9, 0];
        let masked = seen(r#"{"k1": 0.001}"#, &masked);
        assert!(masked.pixels.iter().all(|pixel| pixel[3] == 0 || *pixel == [255; 4]));
    }

    #[test]
    fn lenses_of_other_models_are_refused() {
        for (found, wanted) in [
            (r#"{"camera_model": "OPENCV_FISHEYE"}"#, Ok(true)),
            (r#"{"camera_model": "FOV", "k1": 0.1}"#, Err(())),
            (r#"{"camera_model": "EQUIRECTANGULAR"}"#, Err(())),
            (r#"{"camera_model": "SIMPLE_PINHOLE"}"#, Ok(false)),
            (r#"{"k4": 0.2, "is_fisheye": false}"#, Ok(true)),
            (r#"{"k1": 0.0, "p2": 1e-9}"#, Ok(false)),
            (r#"{"p2": 0.01}"#, Ok(true)),
        ] {
            let lens = lens(found);
            assert_eq!(lens.distortion().map(|d| d.is_some()).map_err(drop), wanted, "{found}");
        }
    }
}
