//! A renderer of the tests' own: it pastes a module, with every switch on, and calls one of its functions with exact arguments, a call a
//! pixel.
//!
//! Arguments come from a texture of floats and not from interpolation or arithmetic in a shader, so that both sides start from the
//! same bits: texel edges, infinities and derivatives can be given as they are.

#[path = "../../examples/support/offscreen.rs"]
mod offscreen;

use std::collections::HashMap;
use std::sync::{Mutex, OnceLock};

use texfold_gpu::{Gpu, GpuTexture, ModuleInfo, wgpu};
use texfold_shaders::{Slot, paste};
use wgpu::{BindGroupLayout, RenderPipeline, TextureFormat, TextureUsages};

use super::Call;

/// Calls in a row of the target: rows of 16 bytes each need no padding when they are read back.
const ROW: u32 = 256;
/// Texels of arguments that a call has.
const ARGUMENTS: usize = 2;

const SHADER: &str = "
@group(1) @binding(0) var arguments: texture_2d<f32>;

@vertex
fn vs(@builtin(vertex_index) index: u32) -> @builtin(position) vec4<f32> {
    let corner = vec2<f32>(f32(index & 1u), f32(index >> 1u)) * 4.0 - vec2<f32>(1.0);
    return vec4<f32>(corner, 0.0, 1.0);
}

@fragment
fn fs(@builtin(position) position: vec4<f32>) -> @location(0) vec4<f32> {
    let pixel = vec2<i32>(position.xy);
    let a = textureLoad(arguments, vec2<i32>(2 * pixel.x, pixel.y), 0);
    let b = textureLoad(arguments, vec2<i32>(2 * pixel.x + 1, pixel.y), 0);
    BODY
}
";

/// The functions that read one level, chosen by the last number of `a`: one pipeline, as software renderers compile each for every
/// texture anew, which takes most of the time of these tests.
const LEVEL_FUNCTIONS: &str = "
    let level = u32(a.z);
    switch u32(a.w) {
        case 0u: { return NAME_fetch(SURFACEvec2<i32>(a.xy), level); }
        case 1u: { return NAME_nearest(SURFACEa.xy, level); }
        default: { return NAME_bilinear(SURFACEa.xy, level); }
    }
";

/// What a pixel does: statements in WGSL that return a colour made of the texels `a` and `b` of arguments.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
pub(crate) struct Function {
    pub(crate) module: &'static ModuleInfo,
    pub(crate) body: String,
    /// Switches of the module that are off, by their names.
    pub(crate) off: Vec<String>,
}

/// Switches of a module in a pipeline.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Switches {
    /// All on, as a shader is pasted.
    On,
    /// Those that the texture needs, as `GpuTexture::constants` gives them.
    Needed,
}

/// The GPU's answers to calls for image `image`: of the functions that read one level, or all of one function.
pub(crate) fn answers(
    gpu: &Gpu,
    texture: &GpuTexture,
    image: u32,
    switches: Switches,
    calls: &[Call],
) -> Vec<[f32; 4]> {
    let slot = Slot::new(texture.module(), 0, 0);
    let (bind_group, place) = texture.bind_group(image).unwrap();
    let name = slot.sample_function().replace("_sample", "");
    let image = if texture.module().has_image { format!("{place}u, ") } else { String::new() };
    let body = match calls[0] {
        Call::Fetch { .. } | Call::Nearest { .. } | Call::Bilinear { .. } => {
            LEVEL_FUNCTIONS.replace("NAME", &name).replace("SURFACE", &image)
        }
        Call::Level { .. } => format!("return {name}_sample_level({image}a.xy, a.z);"),
        Call::Grad { .. } => format!("return {name}_sample_grad({image}a.xy, b.xy, b.zw);"),
    };
    let is_off = |constant: &(String, f64)| switches == Switches::Needed && constant.1 == 0.0;
    let off = texture.constants(&slot).into_iter().filter(is_off).map(|constant| constant.0).collect();
    let function = Function { module: texture.module(), body, off };
    let arguments: Vec<[[f32; 4]; ARGUMENTS]> = calls.iter().map(|&call| arguments(call)).collect();
    run(gpu, &function, bind_group, &arguments)
}

fn arguments(call: Call) -> [[f32; 4]; ARGUMENTS] {
    match call {
        Call::Fetch { at, level } => [[at.x as f32, at.y as f32, level as f32, 0.0], [0.0; 4]],
        Call::Nearest { uv, level } => [[uv.x, uv.y, level as f32, 1.0], [0.0; 4]],
        Call::Bilinear { uv, level } => [[uv.x, uv.y, level as f32, 2.0], [0.0; 4]],
        Call::Level { uv, lod } => [[uv.x, uv.y, lod, 0.0], [0.0; 4]],
        Call::Grad { uv, dx, dy } => [[uv.x, uv.y, 0.0, 0.0], [dx.x, dx.y, dy.x, dy.y]],
    }
}

/// Draws a pixel for each element of `arguments`.
pub(crate) fn run(
    gpu: &Gpu,
    function: &Function,
    bind_group: &wgpu::BindGroup,
    arguments: &[[[f32; 4]; ARGUMENTS]],
) -> Vec<[f32; 4]> {
    let device = gpu.device();
    let rows = (arguments.len() as u32).div_ceil(ROW);
    let mut texels = arguments.to_vec();
    texels.resize((rows * ROW) as usize, [[0.0; 4]; ARGUMENTS]);
    let source = device.create_texture(&wgpu::TextureDescriptor {
        label: None,
        size: wgpu::Extent3d { width: ROW * ARGUMENTS as u32, height: rows, depth_or_array_layers: 1 },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format: TextureFormat::Rgba32Float,
        usage: TextureUsages::TEXTURE_BINDING | TextureUsages::COPY_DST,
        view_formats: &[],
    });
    let row_bytes = Some(16 * ROW * ARGUMENTS as u32);
    let layout = wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: row_bytes, rows_per_image: None };
    gpu.queue().write_texture(source.as_image_copy(), bytemuck::cast_slice(&texels), layout, source.size());
    let inputs = device.create_bind_group(&wgpu::BindGroupDescriptor {
        label: None,
        layout: &inputs_layout(gpu),
        entries: &[wgpu::BindGroupEntry {
            binding: 0,
            resource: wgpu::BindingResource::TextureView(&offscreen::view_of(&source)),
        }],
    });
    let target = offscreen::target(gpu, (ROW, rows), TextureFormat::Rgba32Float);
    let found = offscreen::draw(gpu, &pipeline(gpu, function), &[bind_group, &inputs], &target).unwrap();
    bytemuck::cast_slice(&found)[..arguments.len()].to_vec()
}

fn inputs_layout(gpu: &Gpu) -> BindGroupLayout {
    gpu.device().create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
        label: None,
        entries: &[wgpu::BindGroupLayoutEntry {
            binding: 0,
            visibility: wgpu::ShaderStages::FRAGMENT,
            ty: wgpu::BindingType::Texture {
                sample_type: wgpu::TextureSampleType::Float { filterable: false },
                view_dimension: wgpu::TextureViewDimension::D2,
                multisampled: false,
            },
            count: None,
        }],
    })
}

/// The pipeline of a function, made on first use: software renderers take seconds for long ones.
fn pipeline(gpu: &Gpu, function: &Function) -> RenderPipeline {
    static PIPELINES: OnceLock<Mutex<HashMap<(usize, Function), RenderPipeline>>> = OnceLock::new();
    let mut known = PIPELINES.get_or_init(Mutex::default).lock().unwrap();
    // Devices of several instances compare equal; those of the tests stay where they are.
    let key = (std::ptr::from_ref(gpu).addr(), function.clone());
    known.entry(key).or_insert_with(|| make(gpu, function)).clone()
}

fn make(gpu: &Gpu, function: &Function) -> RenderPipeline {
    let own = SHADER.replace("BODY", &function.body);
    let source =
        wgpu::ShaderSource::Wgsl((paste(&[Slot::new(function.module, 0, 0)]).unwrap() + &own).into());
    let shader = gpu.device().create_shader_module(wgpu::ShaderModuleDescriptor { label: None, source });
    let groups = [Some(gpu.bind_group_layout(function.module)), Some(&inputs_layout(gpu))];
    let off: Vec<(&str, f64)> = function.off.iter().map(|name| (name.as_str(), 0.0)).collect();
    offscreen::pipeline(gpu, &shader, &groups, &off, TextureFormat::Rgba32Float)
}
