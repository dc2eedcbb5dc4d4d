//! Photographs projected onto the mesh again: the nearest one, or a blend of three (Buehler et al. 2001), as peers of light fields.

use glam::{Vec2, Vec3};
use texfold::lightfield::Renderer;
use texfold_core::{Camera, Photograph, parallel};

/// Distances of two hits on one ray that are one place, as a share.
const SAME_PLACE: f32 = 2e-3;
/// Alpha from which a pixel shows the object.
const OPAQUE: u8 = 250;
/// Photographs that are blended.
const BLENDED: usize = 3;

/// The view of a camera by the photographs whose directions are nearest of those that see a place: one, or a blend of three. Row by row, clear
/// where none sees it.
#[must_use]
pub fn draw_photographs(
    views: &[Photograph],
    renderer: &Renderer<'_>,
    camera: &Camera,
    is_blended: bool,
) -> Vec<[u8; 4]> {
    let eye = camera.eye();
    let mut pixels = vec![[0; 4]; (camera.width * camera.height) as usize];
    parallel::for_each_row(&mut pixels, camera.width as usize, |row, line| {
        for (column, pixel) in line.iter_mut().enumerate() {
            let ray = camera.ray(Vec2::new(column as f32, row as f32) + 0.5);
            let Some((distance, _)) = renderer.meet(eye, ray) else { continue };
            *pixel = colour(views, renderer, (eye + distance * ray, -ray), is_blended);
        }
    });
    pixels
}

/// The colour of a place towards a direction; clear where no photograph shows it.
fn colour(
    views: &[Photograph],
    renderer: &Renderer<'_>,
    (place, towards): (Vec3, Vec3),
    is_blended: bool,
) -> [u8; 4] {
    let angle = |view: &Photograph| {
        (view.camera.eye() - place).normalize_or_zero().dot(towards).clamp(-1.0, 1.0).acos()
    };
    let mut order: Vec<(f32, usize)> =
        views.iter().enumerate().map(|(number, view)| (angle(view), number)).collect();
    order.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut seen = order
        .into_iter()
        .filter_map(|(angle, view)| Some((angle, colour_of(&views[view], renderer, place)?)));
    if !is_blended {
        return seen.next().map_or([0; 4], |(_, pixel)| pixel);
    }
    let found: Vec<(f32, [u8; 4])> = seen.take(BLENDED + 1).collect();
    let Some(&(farthest, first)) = found.last() else { return [0; 4] };
    // Weights fall to zero at the next one, so that a photograph that takes another's place comes in smoothly.
    let weight = |angle: f32| (1.0 - angle / farthest.max(1e-6)).max(0.0) / angle.max(1e-4);
    let sum: f32 = found.iter().map(|(angle, _)| weight(*angle)).sum();
    if sum <= 0.0 {
        return first;
    }
    let channel = |channel: usize| {
        let value: f32 = found.iter().map(|(angle, pixel)| weight(*angle) * f32::from(pixel[channel])).sum();
        (value / sum + 0.5) as u8
    };
    [channel(0), channel(1), channel(2), u8::MAX]
}

/// The pixel of a photograph that shows a place, where it does.
pub(super) fn colour_of(view: &Photograph, renderer: &Renderer<'_>, place: Vec3) -> Option<[u8; 4]> {
    let camera = &view.camera;
    let at = camera.project(camera.to_camera().transform_point3(place))?;
    if at.min_element() < 0.0 || at.x >= camera.width as f32 || at.y >= camera.height as f32 {
        return None;
    }
    let pixel = view.pixels[at.y as usize * camera.width as usize + at.x as usize];
    let (distance, _) = renderer.meet(camera.eye(), place - camera.eye())?;
    (pixel[3] > OPAQUE && (distance - 1.0).abs() < SAME_PLACE).then_some(pixel)
}
