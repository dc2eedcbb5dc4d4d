//! A Texfold file or bank in a window.
//!
//! `cargo run --release --manifest-path crates/window/Cargo.toml -- FILE.txf [--mesh MODEL.obj]` shows images (on a wall, or on a mesh with texture coordinates), a light
//! field, a zoom stack or the folder of a bank. Drag to turn, scroll to come closer, arrow keys for further images, 0 to 8 for the terms of a light field, Escape to end. The title
//! has the time of a frame and the bytes on the GPU.

mod content;
mod draw;
mod orbit;

use std::error::Error;
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;
use std::time::Instant;

use clap::Parser;
use texfold_gpu::{Gpu, wgpu};
use winit::application::ApplicationHandler;
use winit::dpi::LogicalSize;
use winit::event::{ElementState, KeyEvent, MouseButton, MouseScrollDelta, WindowEvent};
use winit::event_loop::{ActiveEventLoop, EventLoop};
use winit::keyboard::{Key, NamedKey};
use winit::window::{Window, WindowId};

use content::Content;
use orbit::Orbit;

/// Frames that the time in the title is the mean of.
const FRAMES: u32 = 30;
/// Colour behind all.
const BACKGROUND: wgpu::Color = wgpu::Color { r: 0.2, g: 0.22, b: 0.25, a: 1.0 };
/// Pixels of a line of a mouse's wheel.
const LINE: f32 = 40.0;

/// Shows a Texfold file or bank in a window.
#[derive(Debug, Parser)]
struct Args {
    /// A .txf file, or the folder of a bank.
    file: PathBuf,
    /// An OBJ model with texture coordinates, which images are drawn on.
    #[arg(long)]
    mesh: Option<PathBuf>,
    /// End after so many frames, turning a little in each.
    #[arg(long)]
    frames: Option<u32>,
}

fn main() -> ExitCode {
    match run(Args::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::FAILURE
        }
    }
}

fn run(args: Args) -> Result<(), Box<dyn Error>> {
    // The file first: its faults need no window.
    content::check(&args.file)?;
    let event_loop = EventLoop::new().map_err(|error| format!("there is no display: {error}"))?;
    let mut app = App { args, shown: None, failed: None };
    event_loop.run_app(&mut app)?;
    app.failed.map_or(Ok(()), Err)
}

/// State of the event loop.
struct App {
    args: Args,
    shown: Option<Shown>,
    failed: Option<Box<dyn Error>>,
}

/// A window, and what is in it.
struct Shown {
    window: Arc<Window>,
    surface: wgpu::Surface<'static>,
    config: wgpu::SurfaceConfiguration,
    depth: wgpu::TextureView,
    gpu: Gpu,
    content: Content,
    orbit: Orbit,
    pointer: Option<(f64, f64)>,
    is_pressed: bool,
    frame: u32,
    since: Instant,
}

impl Shown {
    fn new(event_loop: &ActiveEventLoop, args: &Args) -> Result<Shown, Box<dyn Error>> {
        let attributes = Window::default_attributes()
            .with_title(args.file.display().to_string())
            .with_inner_size(LogicalSize::new(960, 640));
        let window = Arc::new(event_loop.create_window(attributes)?);
        let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle());
        let surface = instance.create_surface(Arc::clone(&window))?;
        let adapter = pollster::block_on(instance.request_adapter(&wgpu::RequestAdapterOptions {
            power_preference: wgpu::PowerPreference::HighPerformance,
            compatible_surface: Some(&surface),
            ..Default::default()
        }))?;
        let features = wgpu::Features::TEXTURE_COMPRESSION_BC | wgpu::Features::TEXTURE_FORMAT_16BIT_NORM;
        let (device, queue) = pollster::block_on(adapter.request_device(&wgpu::DeviceDescriptor {
            required_features: adapter.features() & features,
            required_limits: wgpu::Limits::default().using_resolution(adapter.limits()),
            ..Default::default()
        }))?;
        let size = window.inner_size();
        let mut config = surface
            .get_default_config(&adapter, size.width.max(1), size.height.max(1))
            .ok_or("the adapter cannot draw to this window")?;
        // Colours are drawn as they are stored.
        config.format = config.format.remove_srgb_suffix();
        surface.configure(&device, &config);
        let depth = depth(&device, &config);
        let gpu = Gpu::from_device(device, queue);
        let (content, orbit) = Content::open(&gpu, &args.file, args.mesh.as_deref(), config.format)?;
        Ok(Shown {
            window,
            surface,
            config,
            depth,
            gpu,
            content,
            orbit,
            pointer: None,
            is_pressed: false,
            frame: 0,
            since: Instant::now(),
        })
    }

    fn resize(&mut self, width: u32, height: u32) -> Result<(), Box<dyn Error>> {
        (self.config.width, self.config.height) = (width.max(1), height.max(1));
        self.depth = depth(self.gpu.device(), &self.config);
        self.configure()
    }

    /// Adapts the surface to its size; an error where another program has closed the window.
    fn configure(&self) -> Result<(), Box<dyn Error>> {
        let scope = self.gpu.device().push_error_scope(wgpu::ErrorFilter::Validation);
        self.surface.configure(self.gpu.device(), &self.config);
        pollster::block_on(scope.pop()).map_or(Ok(()), |_| Err("the window is gone".into()))
    }

    fn draw(&mut self) -> Result<(), Box<dyn Error>> {
        use wgpu::CurrentSurfaceTexture::{
            Lost, Occluded, Outdated, Suboptimal, Success, Timeout, Validation,
        };
        let texture = match self.surface.get_current_texture() {
            Success(texture) | Suboptimal(texture) => texture,
            Timeout | Occluded => return Ok(()),
            Outdated | Lost | Validation => return self.configure(),
        };
        let view = texture.texture.create_view(&wgpu::TextureViewDescriptor::default());
        let aspect = self.config.width as f32 / self.config.height as f32;
        let mut encoder =
            self.gpu.device().create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        {
            let mut pass = draw::pipeline::pass(&mut encoder, (&view, &self.depth), BACKGROUND);
            self.content.draw(&self.gpu, &mut pass, self.orbit.projection(aspect), self.orbit.eye());
        }
        self.content.update(&mut encoder);
        self.gpu.queue().submit([encoder.finish()]);
        self.window.pre_present_notify();
        self.gpu.queue().present(texture);
        self.content.read(&self.gpu, self.frame)?;
        self.frame += 1;
        if self.frame.is_multiple_of(FRAMES) {
            let milliseconds = 1e3 * self.since.elapsed().as_secs_f64() / f64::from(FRAMES);
            self.since = Instant::now();
            let title = format!(
                "{}: {milliseconds:.1} ms a frame, {:.1} MB",
                self.content.name(),
                self.content.bytes() as f64 / 1e6
            );
            println!("{title}");
            self.window.set_title(&title);
        }
        Ok(())
    }
}

fn depth(device: &wgpu::Device, config: &wgpu::SurfaceConfiguration) -> wgpu::TextureView {
    let texture = device.create_texture(&wgpu::TextureDescriptor {
        label: Some("depth"),
        size: wgpu::Extent3d { width: config.width, height: config.height, depth_or_array_layers: 1 },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format: draw::pipeline::DEPTH,
        usage: wgpu::TextureUsages::RENDER_ATTACHMENT,
        view_formats: &[],
    });
    texture.create_view(&wgpu::TextureViewDescriptor::default())
}

impl ApplicationHandler for App {
    fn resumed(&mut self, event_loop: &ActiveEventLoop) {
        if self.shown.is_some() {
            return;
        }
        match Shown::new(event_loop, &self.args) {
            Ok(shown) => self.shown = Some(shown),
            Err(error) => {
                self.failed = Some(error);
                event_loop.exit();
            }
        }
    }

    fn window_event(&mut self, event_loop: &ActiveEventLoop, _: WindowId, event: WindowEvent) {
        let Some(shown) = &mut self.shown else { return };
        match event {
            WindowEvent::CloseRequested | WindowEvent::Destroyed => event_loop.exit(),
            WindowEvent::Resized(size) => {
                if let Err(error) = shown.resize(size.width, size.height) {
                    self.failed = Some(error);
                    event_loop.exit();
                }
            }
            WindowEvent::CursorMoved { position, .. } => {
                let before = shown.pointer.replace((position.x, position.y));
                if let (true, Some((x, y))) = (shown.is_pressed, before) {
                    shown.orbit.turn((position.x - x) as f32, (position.y - y) as f32);
                }
            }
            WindowEvent::MouseInput { state, button: MouseButton::Left, .. } => {
                shown.is_pressed = state == ElementState::Pressed;
            }
            WindowEvent::MouseWheel { delta, .. } => shown.orbit.zoom(match delta {
                MouseScrollDelta::LineDelta(_, lines) => LINE * lines,
                MouseScrollDelta::PixelDelta(pixels) => pixels.y as f32,
            }),
            WindowEvent::KeyboardInput {
                event: KeyEvent { logical_key, state: ElementState::Pressed, .. },
                ..
            } => match logical_key {
                Key::Named(NamedKey::Escape) => event_loop.exit(),
                Key::Named(NamedKey::ArrowRight) => shown.content.turn_over(1),
                Key::Named(NamedKey::ArrowLeft) => shown.content.turn_over(-1),
                Key::Character(text) => {
                    if let Ok(terms) = text.parse() {
                        shown.content.set_terms(terms);
                    }
                }
                _ => {}
            },
            WindowEvent::RedrawRequested => {
                if let Err(error) = shown.draw() {
                    self.failed = Some(error);
                    event_loop.exit();
                } else if self.args.frames.is_some_and(|frames| shown.frame >= frames) {
                    event_loop.exit();
                }
            }
            _ => {}
        }
    }

    fn about_to_wait(&mut self, _: &ActiveEventLoop) {
        if let Some(shown) = &mut self.shown {
            if self.args.frames.is_some() {
                shown.orbit.turn(4.0, 0.0);
            }
            shown.window.request_redraw();
        }
    }
}
