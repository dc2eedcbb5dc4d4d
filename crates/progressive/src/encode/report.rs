//! How a texture was made, in words.

use texfold_core::RESIDUAL_PART;
use texfold_core::image::ImageSet;
use texfold_core::metric::quality_cancellable;
use texfold_core::{CancelCheck, EncodeError, Encoded, Metric, Notes};

use crate::codebook::CELL_SIDE;
use crate::codebook::MAP_PART;
use crate::{Details, ProgressiveParams, ProgressiveTexture};

/// Settings, verdict, and the PSNR of the base alone.
pub(crate) fn notes(
    source: &ImageSet,
    texture: &ProgressiveTexture,
    params: &ProgressiveParams,
    met: bool,
    check: CancelCheck<'_>,
) -> Result<Notes, EncodeError> {
    let psnr = |texture: &ProgressiveTexture| {
        quality_cancellable(source, texture, check).map(|quality| quality.color.psnr() as f32)
    };
    let alone = psnr(&texture.first_layers(1))?;
    let drawn = texture.layers().total > 1;
    let mut psnr_without = if drawn { vec![(RESIDUAL_PART.to_owned(), alone)] } else { Vec::new() };
    if texture.details().is_some() {
        psnr_without.push((MAP_PART.to_owned(), psnr(&texture.without_details())?));
    }
    let metric = params.metric_for(source.info(), params.goal);
    Ok(Notes {
        settings: settings(params, metric),
        verdict: verdict(texture, met),
        psnr_without,
        ..Notes::default()
    })
}

fn settings(params: &ProgressiveParams, metric: Metric) -> String {
    let content = params.content.map_or(String::new(), |content| format!(" --content {}", content.name()));
    let mips = if params.mips { " --mips" } else { "" };
    format!("--codec progressive {}{content}{mips} --metric {}", params.goal.option(), metric.name())
}

fn verdict(texture: &ProgressiveTexture, met: bool) -> String {
    let base = format!(
        "A base of 1/{} of the width and height in {}",
        1 << texture.reduce_log2(),
        texture.base_content().name().to_uppercase()
    );
    let base = match texture.shrink_log2() {
        0 => base,
        log2 => format!("An image of 1/{} of the width and height, enlarged: a{}", 1 << log2, &base[1..]),
    };
    let base = match texture.details() {
        Some(details) => format!("{base}{}", described(details)),
        None => base,
    };
    let missed = if met { "" } else { " The goal is out of reach; this comes nearest." };
    let images = texture.layout().images.len() as u32;
    let classes: Vec<u8> = (0..images).flat_map(|index| texture.classes(index)).collect();
    if classes.is_empty() {
        return format!("{base} alone: no error is worth its bits.{missed}");
    }
    let none = classes.iter().filter(|&&class| class == 0).count();
    let bits: u64 = classes.iter().map(|&class| u64::from(class)).sum::<u64>();
    let texels = (classes.len() * 64) as f64;
    format!(
        "{base}; errors in {:.2} bits a texel, none in {:.0}% of the blocks.{missed}",
        bits as f64 * f64::from(texture.model().class_bits) / texels,
        100.0 * none as f64 / classes.len() as f64
    )
}

/// What codebooks a texture uses.
fn described(details: &Details) -> String {
    let side = 1 << details.form.side_log2;
    let cells = |book: &Option<std::sync::Arc<crate::Codebook>>| {
        book.as_ref().map_or(0, |book| book.size().0 * book.size().1 / (CELL_SIDE * CELL_SIDE))
    };
    let entries = || details.maps.iter().flat_map(|map| map.entries(details.form));
    let used = entries().filter(|entry| entry.gain % 16 > 0).count();
    format!(
        ", with details from {} public and {} own cells of a codebook in {:.0}% of the {side}x{side} blocks",
        cells(&details.public),
        cells(&details.private),
        100.0 * used as f64 / entries().count().max(1) as f64
    )
}
