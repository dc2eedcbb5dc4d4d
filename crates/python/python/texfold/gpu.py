"""Textures in blocks on a GPU: what any interface to one is given, and a decoder for wgpu-py.

    texture = texfold.open("land.txf")
    image = texfold.gpu.Decoder(device).decode(texture)     # a wgpu texture with mip levels

Texels are those of `Texture.decode`, bit by bit. ``pip install './crates/python[gpu]'`` brings wgpu-py.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from . import RegionError, Texture, _texfold

__all__ = ["Blocks", "Decoder", "Dispatch", "Program", "blocks"]


class Dispatch(NamedTuple):
    """A call of a function of the shader. It reads what those before it wrote to scratch memory."""

    entry: str
    """Name of the function."""
    clears: bool
    """Whether scratch memory is filled with zeros before it."""
    pass_offset: int
    """Byte of `Program.passes` from which group 0, binding 0 is bound."""
    output_offset: int
    """Byte of `Program.outputs` from which group 1, binding 0 is bound; of ``write_texels`` alone."""
    level: int
    """Mip level that group 1, binding 1 is bound to, counted from the first one; of ``write_texels`` alone."""
    groups: tuple[int, int, int]
    """Workgroups."""


class Program(NamedTuple):
    """Dispatches that decode levels or a region, and their parameters."""

    passes: bytes
    """Uniform buffer of group 0, binding 0; `pass_bytes` of it are bound."""
    outputs: bytes
    """Uniform buffer of group 1, binding 0; `output_bytes` of it are bound."""
    pass_bytes: int
    output_bytes: int
    scratch_bytes: int
    """Bytes of the storage buffer of group 0, binding 3."""
    dispatches: list[Dispatch]


class Blocks:
    """A texture in blocks of variable length: an image, or some of its mip levels."""

    def __init__(self, blocks: _texfold.Blocks) -> None:
        self._blocks = blocks

    shape = property(lambda self: self._blocks.shape, doc="Rows and columns.")
    bits = property(lambda self: self._blocks.bits, doc="Bits of a sample: to 8 decoded to rgba8unorm, else rgba16uint.")
    image = property(lambda self: self._blocks.place[0], doc="Number of the image.")
    level = property(lambda self: self._blocks.place[1], doc="First mip level of the image that it is.")
    levels = property(lambda self: self._blocks.place[2], doc="Mip levels that are made of it.")
    words = property(lambda self: self._blocks.words, doc="Storage buffer of group 0, binding 1.")
    streams = property(lambda self: self._blocks.streams, doc="Storage buffer of group 0, binding 2.")
    shader = property(lambda self: self._blocks.shader, doc="WGSL of the decoder.")

    def program(
        self,
        *,
        level: int = 0,
        region: tuple[int, int, int, int] | None = None,
        place: tuple[int, int] = (0, 0),
        max_scratch: int = 128 << 20,
    ) -> Program:
        """Dispatches that decode all levels, or a region of a level (column, row, columns, rows) to a place of the target, within so many
        bytes of scratch memory: by default what every WebGPU device binds. Large textures are faster within more.

        Raises
        ------
        RegionError
            A level or region that does not exist.
        """
        wanted = None if region is None else (level, tuple(region))
        passes, outputs, bound, scratch, dispatches = self._blocks.program(wanted, place, max_scratch)
        return Program(passes, outputs, *bound, scratch, [Dispatch(*dispatch) for dispatch in dispatches])


def blocks(texture: Texture, image: int | str = 0) -> list[Blocks]:
    """The textures in blocks of an image, or of the map of that name; none where texels are read without decoding.

    Raises
    ------
    RegionError
        An image that does not exist.
    """
    number, images = texture._place(image, 0)[0], len(texture.shapes)
    if number >= images:
        raise RegionError(f"image {number} of {images}; ask for one below that number")
    return [Blocks(blocks) for blocks in texture._texture.blocks() if blocks.place[0] == number]


class Decoder:
    """Decodes images by compute passes of a device of wgpu-py. Pipelines are made once for 8 and once for 16 bits.

    Parameters
    ----------
    device
        A ``wgpu.GPUDevice``.
    """

    def __init__(self, device: Any) -> None:
        self._device = device
        self._pipelines: dict[str, _Pipelines] = {}

    def decode(self, texture: Texture, image: int | str = 0) -> Any:
        """Decodes an image, given by its number or the name of a map.

        Returns
        -------
        wgpu.GPUTexture
            ``rgba8unorm``, or ``rgba16uint`` for more than 8 bits, with all stored mip levels, to be sampled or copied.

        Raises
        ------
        ValueError
            A codec whose texels are read without decoding.
        """
        from wgpu import TextureUsage

        stages = blocks(texture, image)
        if not stages:
            raise ValueError(f"codec {texture.codec} has no blocks here; draw its planes with the shader of its name")
        first = stages[0]
        target = self._device.create_texture(
            size=(first.shape[1], first.shape[0], 1),
            format=_format(first.bits),
            usage=TextureUsage.STORAGE_BINDING | TextureUsage.TEXTURE_BINDING | TextureUsage.COPY_SRC,
            mip_level_count=sum(stage.levels for stage in stages),
        )
        for stage in stages:
            self.run(stage, stage.program(), target)
        return target

    def run(self, stage: Blocks, program: Program, target: Any) -> None:
        """Submits a program that writes to a texture of the format that `decode` makes."""
        from wgpu import BufferUsage

        device, format = self._device, _format(stage.bits)
        if format not in self._pipelines:
            self._pipelines[format] = _Pipelines(device, stage.shader, format)
        pipelines = self._pipelines[format]
        filled = device.create_buffer_with_data
        words, streams = (filled(data=data, usage=BufferUsage.STORAGE) for data in (stage.words, stage.streams))
        passes, outputs = (filled(data=data, usage=BufferUsage.UNIFORM) for data in (program.passes, program.outputs))
        scratch = device.create_buffer(size=program.scratch_bytes, usage=BufferUsage.STORAGE | BufferUsage.COPY_DST)
        inputs = [_bound(passes, 0, program.pass_bytes), _bound(words), _bound(streams), _bound(scratch)]
        group = pipelines.group(0, inputs)
        encoder = device.create_command_encoder()
        work = None
        for dispatch in program.dispatches:
            if dispatch.clears:
                if work is not None:
                    work.end()
                encoder.clear_buffer(scratch)
                work = encoder.begin_compute_pass()
            work.set_pipeline(pipelines.of[dispatch.entry])
            work.set_bind_group(0, group, [dispatch.pass_offset])
            if dispatch.entry == "write_texels":
                view = target.create_view(base_mip_level=stage.level + dispatch.level, mip_level_count=1)
                output = _bound(outputs, dispatch.output_offset, program.output_bytes)
                work.set_bind_group(1, pipelines.group(1, [output, view]))
            work.dispatch_workgroups(*dispatch.groups)
        work.end()
        device.queue.submit([encoder.finish()])


class _Pipelines:
    """The shader's functions for a format of the target."""

    def __init__(self, device: Any, shader: str, format: str) -> None:
        from wgpu import ShaderStage

        def layout(*resources: dict[str, Any]) -> Any:
            entries = [
                {"binding": binding, "visibility": ShaderStage.COMPUTE, **resource}
                for binding, resource in enumerate(resources)
            ]
            return device.create_bind_group_layout(entries=entries)

        stored = {"buffer": {"type": "read-only-storage"}}
        passes = {"buffer": {"type": "uniform", "has_dynamic_offset": True}}
        target = {"storage_texture": {"access": "write-only", "format": format}}
        scratch = {"buffer": {"type": "storage"}}
        self._device = device
        self._layouts = [layout(passes, stored, stored, scratch), layout({"buffer": {"type": "uniform"}}, target)]
        module = device.create_shader_module(code=shader)
        self.of = {}
        names = ("read_superblocks", "transform_blocks", "predict_blocks", "deblock_columns", "deblock_rows", "write_texels")
        for entry in names:
            groups = self._layouts if entry == "write_texels" else self._layouts[:1]
            whole = device.create_pipeline_layout(bind_group_layouts=groups)
            self.of[entry] = device.create_compute_pipeline(layout=whole, compute={"module": module, "entry_point": entry})

    def group(self, number: int, resources: list[Any]) -> Any:
        """A bind group of that number."""
        entries = [{"binding": binding, "resource": resource} for binding, resource in enumerate(resources)]
        return self._device.create_bind_group(layout=self._layouts[number], entries=entries)


def _format(bits: int) -> str:
    return "rgba8unorm" if bits <= 8 else "rgba16uint"


def _bound(buffer: Any, offset: int = 0, size: int | None = None) -> dict[str, Any]:
    return {"buffer": buffer, "offset": offset, "size": buffer.size if size is None else size}
