//! ASTC blocks, by Arm's encoder where the program is built with the feature `astc`.

use ktx2::Format;

/// Texels along the side of a block.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum AstcSide {
    Four,
    Six,
    Eight,
}

impl AstcSide {
    /// The format in the words of Vulkan.
    pub(super) fn format(self, is_srgb: bool) -> Format {
        let [linear, srgb] = match self {
            AstcSide::Four => [Format::ASTC_4x4_UNORM_BLOCK, Format::ASTC_4x4_SRGB_BLOCK],
            AstcSide::Six => [Format::ASTC_6x6_UNORM_BLOCK, Format::ASTC_6x6_SRGB_BLOCK],
            AstcSide::Eight => [Format::ASTC_8x8_UNORM_BLOCK, Format::ASTC_8x8_SRGB_BLOCK],
        };
        if is_srgb { srgb } else { linear }
    }

    pub(super) fn texels(self) -> u32 {
        match self {
            AstcSide::Four => 4,
            AstcSide::Six => 6,
            AstcSide::Eight => 8,
        }
    }
}

/// Blocks of an image of RGBA.
#[cfg(feature = "astc")]
pub(super) fn encode(
    side: AstcSide,
    (width, height): (u32, u32),
    rgba: &mut [u8],
    is_srgb: bool,
) -> Result<Vec<u8>, String> {
    use ctt_astcenc as astc;

    let texels = side.texels();
    let profile = if is_srgb {
        astc::astcenc_profile_ASTCENC_PRF_LDR_SRGB
    } else {
        astc::astcenc_profile_ASTCENC_PRF_LDR
    };
    let failed = |error: astc::Error| error.to_string();
    let config =
        astc::config_init(profile, texels, texels, 1, astc::ASTCENC_PRE_MEDIUM, 0).map_err(failed)?;
    let mut context = astc::Context::new(&config).map_err(failed)?;
    let mut slices = [rgba.as_mut_ptr().cast()];
    let mut image = astc::astcenc_image {
        dim_x: width,
        dim_y: height,
        dim_z: 1,
        data_type: astc::astcenc_type_ASTCENC_TYPE_U8,
        data: slices.as_mut_ptr(),
    };
    let swizzle = astc::astcenc_swizzle {
        r: astc::astcenc_swz_ASTCENC_SWZ_R,
        g: astc::astcenc_swz_ASTCENC_SWZ_G,
        b: astc::astcenc_swz_ASTCENC_SWZ_B,
        a: astc::astcenc_swz_ASTCENC_SWZ_A,
    };
    let blocks = width.div_ceil(texels) as usize * height.div_ceil(texels) as usize;
    let mut data = vec![0; 16 * blocks];
    context.compress(&mut image, &swizzle, &mut data).map_err(failed)?;
    Ok(data)
}

/// Says how to have it.
#[cfg(not(feature = "astc"))]
pub(super) fn encode(_: AstcSide, _: (u32, u32), _: &mut [u8], _: bool) -> Result<Vec<u8>, String> {
    Err("this program has no encoder for ASTC; build it with --features astc, which takes a C++ compiler"
        .to_owned())
}
