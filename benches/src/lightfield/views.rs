//! How close drawn views come to photographs.

use texfold::core::{Camera, Photograph};

/// Share of the object's pixels that are called brightest.
const BRIGHTEST: f64 = 0.1;

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
