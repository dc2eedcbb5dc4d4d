//! Colour profiles: values of a profile other than sRGB are converted to sRGB.

use image::DynamicImage;
use moxcms::{CmsError, ColorProfile, Layout, ProfileText, TransformExecutor, TransformOptions};

/// Largest difference in 8-bit steps that a conversion makes where a profile is sRGB by other words.
const SAME: u8 = 1;
/// Texels that are converted at a time.
const AT_A_TIME: usize = 4096;

/// Layouts of texels of so many channels, and of what they are converted to.
fn layouts(channels: usize) -> (Layout, Layout) {
    match channels {
        1 => (Layout::Gray, Layout::Rgb),
        2 => (Layout::GrayAlpha, Layout::Rgba),
        3 => (Layout::Rgb, Layout::Rgb),
        _ => (Layout::Rgba, Layout::Rgba),
    }
}

/// Converts an image to sRGB: the profile's name, or `None` where the profile is sRGB.
pub(super) fn to_srgb(image: &mut DynamicImage, profile: &[u8]) -> Result<Option<String>, CmsError> {
    let profile = ColorProfile::new_from_slice(profile)?;
    let channels = usize::from(image.color().channel_count());
    if is_srgb(&profile, channels)? {
        return Ok(None);
    }
    let (from, to) = layouts(channels);
    let srgb = ColorProfile::new_srgb();
    let eight = || profile.create_transform_8bit(from, &srgb, to, TransformOptions::default());
    let sixteen = || profile.create_transform_16bit(from, &srgb, to, TransformOptions::default());
    match image {
        DynamicImage::ImageLuma8(image) => convert(image, 1, &*eight()?)?,
        DynamicImage::ImageLumaA8(image) => convert(image, 2, &*eight()?)?,
        DynamicImage::ImageRgb8(image) => convert(image, 3, &*eight()?)?,
        DynamicImage::ImageRgba8(image) => convert(image, 4, &*eight()?)?,
        DynamicImage::ImageLuma16(image) => convert(image, 1, &*sixteen()?)?,
        DynamicImage::ImageLumaA16(image) => convert(image, 2, &*sixteen()?)?,
        DynamicImage::ImageRgb16(image) => convert(image, 3, &*sixteen()?)?,
        DynamicImage::ImageRgba16(image) => convert(image, 4, &*sixteen()?)?,
        _ => return Ok(None),
    }
    Ok(Some(name(&profile)))
}

/// True where the profile has the values of sRGB, and without a profile.
pub(super) fn keeps_values(profile: Option<&[u8]>, channels: usize) -> bool {
    profile.is_none_or(|profile| {
        ColorProfile::new_from_slice(profile)
            .is_ok_and(|profile| is_srgb(&profile, channels).unwrap_or(false))
    })
}

/// Names of sRGB profiles differ, and their curves are tables or formulas: what they do to values tells them.
fn is_srgb(profile: &ColorProfile, channels: usize) -> Result<bool, CmsError> {
    let colors = if channels < 3 { 1 } else { 3 };
    let mut probes: Vec<u8> = if colors == 1 {
        (0..=u8::MAX).collect()
    } else {
        (0..6 * 6 * 6u8).flat_map(|i| [i % 6 * 51, i / 6 % 6 * 51, i / 36 * 51]).collect()
    };
    let given = probes.clone();
    let (from, to) = layouts(colors);
    let transform =
        profile.create_transform_8bit(from, &ColorProfile::new_srgb(), to, TransformOptions::default())?;
    convert(&mut probes, colors, &*transform)?;
    Ok(given.iter().zip(&probes).all(|(given, found)| given.abs_diff(*found) <= SAME))
}

/// Converts values in place; of gray the red of its colour is kept.
fn convert<T: Copy + Default>(
    values: &mut [T],
    channels: usize,
    transform: &(impl TransformExecutor<T> + ?Sized),
) -> Result<(), CmsError> {
    let wide = channels + if channels < 3 { 2 } else { 0 };
    let mut converted = vec![T::default(); AT_A_TIME * wide];
    for texels in values.chunks_mut(AT_A_TIME * channels) {
        let converted = &mut converted[..texels.len() / channels * wide];
        transform.transform(texels, converted)?;
        for (texel, converted) in texels.chunks_exact_mut(channels).zip(converted.chunks_exact(wide)) {
            texel.copy_from_slice(&converted[..channels]);
            texel[channels - 1] = if channels == 2 { converted[wide - 1] } else { texel[channels - 1] };
        }
    }
    Ok(())
}

/// The profile's own description, as one line of text.
fn name(profile: &ColorProfile) -> String {
    let text = match &profile.description {
        Some(ProfileText::PlainString(text)) => text.as_str(),
        Some(ProfileText::Localizable(texts)) => texts.first().map_or("", |text| &text.value),
        Some(ProfileText::Description(text)) => &text.ascii_string,
        None => "",
    };
    let line: String = text.chars().filter(|letter| !letter.is_control()).take(64).collect();
    if line.trim().is_empty() { "a profile without a name".to_owned() } else { line.trim().to_owned() }
}
