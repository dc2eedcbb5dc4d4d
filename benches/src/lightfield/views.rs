//! How close drawn views come to photographs.

use texfold::{
    core::{Camera, Capture, Photograph},
    lightfield::Renderer,
};

/// Share of the object's pixels that are called brightest.
const BRIGHTEST: f64 = 0.1;
/// Distances of two hits on one ray that are one place, as a share.
const SAME_PLACE: f32 = 2e-3;

/// How close views come.
pub(crate) struct Closeness {
    /// PSNR over the pixels of all views.
    pub(crate) psnr: f64,
    /// Of the worst view.
    pub(crate) worst: f64,
    /// Over the brightest pixels.
    pub(crate) brightest: f64,
}

fn db(squares: f64, count: f64) -> f64 {
    10.0 * (65025.0 * 3.0 * count.max(1.0) / squares.max(1e-9)).log10()
}

/// Compares what `draw` gives for the camera of each view with the view.
pub(crate) fn closeness(tests: &[Photograph], draw: impl Fn(&Camera) -> Vec<[u8; 4]>) -> Closeness {
    let mut errors: Vec<(u32, f64)> = Vec::new();
    let mut worst = f64::INFINITY;
    for view in tests {
        let drawn = draw(&view.camera);
        let first = errors.len();
        for (wanted, found) in view.pixels.iter().zip(&drawn).filter(|(wanted, _)| wanted[3] > 127) {
            let squares: f64 = (0..3).map(|c| f64::from(wanted[c].abs_diff(found[c])).powi(2)).sum();
            errors.push((wanted[..3].iter().map(|&value| u32::from(value)).sum(), squares));
        }
        let own = &errors[first..];
        worst = worst.min(db(own.iter().map(|(_, squares)| squares).sum(), own.len() as f64));
    }
    let sum =
        |errors: &[(u32, f64)]| db(errors.iter().map(|(_, squares)| squares).sum(), errors.len() as f64);
    let psnr = sum(&errors);
    errors.sort_by_key(|&(brightness, _)| std::cmp::Reverse(brightness));
    errors.truncate((errors.len() as f64 * BRIGHTEST).ceil() as usize);
    Closeness { psnr, worst, brightest: sum(&errors) }
}

/// The photograph whose direction is nearest of those that see a place, at each pixel of a camera.
pub(crate) fn nearest_photograph(
    capture: &Capture,
    renderer: &Renderer<'_>,
    camera: &Camera,
) -> Vec<[u8; 4]> {
    let eye = camera.eye();
    let pixel = |index: u32| {
        let at = glam::Vec2::new((index % camera.width) as f32, (index / camera.width) as f32) + 0.5;
        let ray = camera.ray(at);
        let Some((distance, _)) = renderer.meet(eye, ray) else { return [0; 4] };
        let place = eye + distance * ray;
        let mut order: Vec<(f32, usize)> = (0..capture.views.len())
            .map(|view| (-(capture.views[view].camera.eye() - place).normalize().dot(-ray), view))
            .collect();
        order.sort_by(|a, b| a.0.total_cmp(&b.0));
        order.iter().find_map(|&(_, view)| colour_of(&capture.views[view], renderer, place)).unwrap_or([0; 4])
    };
    (0..camera.width * camera.height).map(pixel).collect()
}

/// The pixel of a photograph that shows a place, where it does.
fn colour_of(view: &Photograph, renderer: &Renderer<'_>, place: glam::Vec3) -> Option<[u8; 4]> {
    let camera = &view.camera;
    let at = camera.project(camera.to_camera().transform_point3(place))?;
    if at.min_element() < 0.0 || at.x >= camera.width as f32 || at.y >= camera.height as f32 {
        return None;
    }
    let pixel = view.pixels[at.y as usize * camera.width as usize + at.x as usize];
    let (distance, _) = renderer.meet(camera.eye(), place - camera.eye())?;
    (pixel[3] > 250 && (distance - 1.0).abs() < SAME_PLACE).then_some(pixel)
}
