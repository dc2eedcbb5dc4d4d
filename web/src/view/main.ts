// The page that `texfold view` writes: shows textures, their errors, where their bits are.

import { Gpu, GpuError, type GpuTexture, LoadError, open, type Texture, type View } from "../index.js";
import { superblocksOf } from "../superblocks.js";
import { BankMap } from "./bank.js";
import { Orbit, Window } from "./camera.js";
import { Difference } from "./compare.js";
import { element, fileOf, type Group, imageOf, type Item, make, readData } from "./data.js";
import { showBankFacts, showFacts } from "./facts.js";
import { listen } from "./input.js";
import { listenForFiles, type Rival } from "./try.js";

type Mode = "decoded" | "original" | "split" | "error" | "rival";
const MODES: [Mode, string][] = [["decoded", "Decoded"], ["original", "Original"], ["split", "Side by side"], ["error", "Error x8"]];

/** What is shown of one file. */
interface Shown {
  texture: Texture;
  drawn: GpuTexture;
  /** One for each image, or none. */
  originals: GpuTexture[];
  /** Images by other encoders. */
  rivals: { name: string; drawn: GpuTexture }[];
  window: Window;
  orbit: Orbit | null;
}

class Page {
  private readonly canvas = element<HTMLCanvasElement>("view");
  private readonly map = element<HTMLCanvasElement>("map");
  private readonly context: GPUCanvasContext;
  private readonly difference: Difference;
  private readonly format = navigator.gpu.getPreferredCanvasFormat();
  private shown: Shown | null = null;
  /** A bank that is shown in the place of a file, and where of it. */
  private bank: BankMap | null = null;
  private readonly bankWindow = new Window();
  private mode: Mode = "decoded";
  private rival = 0;
  private image = 0;
  /** Place of the file that is shown. */
  private number = -1;
  private level = -1;
  private terms = 8;
  private bits = false;
  private split = 0.5;
  private isWanted = false;
  private isDrawing = false;
  /** Frames that were drawn. */
  frames = 0;

  constructor(private readonly gpu: Gpu, private readonly items: Item[], private readonly groups: Record<string, Group>) {
    this.context = this.canvas.getContext("webgpu") as GPUCanvasContext;
    this.context.configure({ device: gpu.device, format: this.format, alphaMode: "opaque", usage: GPUTextureUsage.RENDER_ATTACHMENT | GPUTextureUsage.COPY_DST });
    this.difference = new Difference(gpu.device, this.format);
    listen(this.canvas, {
      move: (across, down) => this.change((view) => view.move(across, down)),
      zoom: (factor, at) => this.change((view) => view.zoom(factor, at)),
      key: (key) => this.key(key),
    });
    this.dragSplit();
    new ResizeObserver(() => this.resize()).observe(element("stage"));
  }

  /** The window, of images alone. */
  private get window(): Window | undefined {
    return this.bank ? this.bankWindow : this.shown?.window;
  }

  private change(change: (view: Window | Orbit) => void): void {
    const view = this.shown?.orbit ?? this.window;
    if (view) {
      change(view);
      this.want();
    }
  }

  private key(key: string): boolean {
    if (key !== "0" && key !== "1") {
      return false;
    }
    const { window } = this;
    if (key === "0") {
      this.fit();
    } else {
      window?.zoom(1 / window.scale, { x: this.canvas.width / 2, y: this.canvas.height / 2 });
    }
    this.want();
    return true;
  }

  private dragSplit(): void {
    const line = element("split");
    line.addEventListener("pointerdown", (event) => line.setPointerCapture(event.pointerId));
    line.addEventListener("pointermove", (event) => {
      if (line.hasPointerCapture(event.pointerId)) {
        const { left, width } = this.canvas.getBoundingClientRect();
        this.split = Math.min(1, Math.max(0, (event.clientX - left) / width));
        this.want();
      }
    });
  }

  private resize(): void {
    const limit = this.gpu.device.limits.maxTextureDimension2D;
    for (const canvas of [this.canvas, this.map]) {
      canvas.width = Math.min(limit, Math.max(1, Math.round(canvas.clientWidth * devicePixelRatio)));
      canvas.height = Math.min(limit, Math.max(1, Math.round(canvas.clientHeight * devicePixelRatio)));
    }
    this.want();
  }

  /** Loads and shows a file; of the image that was shown before, another one, the window stays. */
  async show(item: Item, rivals: Pick<Rival, "name" | "image">[] = []): Promise<void> {
    if (item.bank) {
      const failed = (why: string): void => element("facts").append(make("p", { role: "alert" }, why));
      this.showBank(item, new BankMap(this.gpu, item.bank.images, `/bank/${this.items.indexOf(item)}/`, () => this.want(), failed));
      return;
    }
    const texture = await open(fileOf(item));
    const drawn = await this.gpu.upload(texture, { coarseFirst: true });
    void drawn.complete.then(() => this.want());
    const group = this.groups[item.group ?? ""] ?? { originals: item.originals, rivals: [] };
    const uploaded = async (data: string): Promise<GpuTexture> => this.gpu.uploadImage(await imageOf(data));
    // Originals of images that the GPU holds from a coarser level on are too large for it.
    const originals = await Promise.all(drawn.skippedLevels > 0 ? [] : group.originals.map(uploaded));
    const decoded = await Promise.all(group.rivals.map(async ({ name, data }) => ({ name, drawn: await uploaded(data) })));
    this.forget();
    const { centre, radius } = item.sphere ?? { centre: [0, 0, 0], radius: 1 };
    const orbit = texture.layout ? null : new Orbit(centre, radius);
    const others = [...rivals.map(({ name, image }) => ({ name, drawn: this.gpu.uploadImage(image) })), ...decoded];
    const before = this.items[this.number];
    const isAlike = before?.group !== undefined && before.group === item.group;
    const stays = (isAlike || before?.name === item.name) && this.shown !== null;
    const window = stays ? this.shown!.window : new Window();
    this.number = this.items.indexOf(item);
    this.shown = { texture, drawn, originals, rivals: others, window, orbit };
    [this.image, this.level, this.bits] = [0, -1, false];
    if (!isAlike || this.mode === "rival") {
      this.mode = "decoded";
    }
    this.terms = texture.layers[0] - 1;
    element("name").textContent = item.name;
    document.title = `${item.name} – Texfold`;
    showFacts(texture, drawn);
    this.choices(item);
    this.resize();
    if (!stays) {
      this.fit();
    }
    this.want();
  }

  /** Shows a bank, of which the program serves the tiles. */
  private showBank(item: Item, bank: BankMap): void {
    this.forget();
    [this.bank, this.shown] = [bank, null];
    this.number = this.items.indexOf(item);
    this.image = 0;
    element("name").textContent = item.name;
    document.title = `${item.name} – Texfold`;
    const choose = (number: number): void => {
      this.image = number;
      showBankFacts(bank.images[number]!);
      this.fit();
      this.want();
    };
    const names = bank.images.map(({ name }) => name);
    element("choices").replaceChildren(...this.fileChoice(item), ...(names.length > 1 ? [select("Image", names, 0, choose)] : []));
    this.resize();
    choose(0);
  }

  /** Frees what is shown. */
  private forget(): void {
    this.shown?.drawn.destroy();
    this.shown?.originals.forEach((original) => original.destroy());
    this.shown?.rivals.forEach((rival) => rival.drawn.destroy());
    this.bank?.destroy();
    this.bank = null;
  }

  /** Adds a file, in the place of one of the same name, and shows it. */
  async take(item: Item, rivals: Rival[]): Promise<void> {
    const place = this.items.findIndex(({ name }) => name === item.name);
    await this.show(place < 0 ? item : Object.assign(this.items[place]!, item), rivals);
    if (place < 0) {
      this.number = this.items.push(item) - 1;
      this.choices(item);
    }
    element("still").hidden = true;
  }

  private fit(): void {
    const size = (this.bank ?? this.shown?.drawn.layout)?.images[this.image];
    if (size) {
      this.window?.fit(size.width, size.height, this.canvas);
    }
  }

  private fileChoice(item: Item): HTMLElement[] {
    const names = this.items.map(({ name }) => name);
    return names.length > 1 ? [select("File", names, this.items.indexOf(item), (number) => void this.tryShow(this.items[number]!))] : [];
  }

  /** Files, modes, images, mip levels, terms. */
  private choices(item: Item): void {
    const { texture, drawn, originals, rivals } = this.shown!, children = this.fileChoice(item);
    const modes: [Mode, string, number][] = [
      ...MODES.filter(([mode]) => mode === "decoded" || originals.length > 0).map(([mode, name]): [Mode, string, number] => [mode, name, 0]),
      ...rivals.map(({ name }, rival): [Mode, string, number] => ["rival", name, rival]),
    ];
    if (modes.length > 1) {
      const buttons = modes.map(([mode, name, rival]) => {
        const button = make("button", { type: "button", "aria-pressed": `${mode === this.mode}` }, name);
        button.addEventListener("click", () => {
          [this.mode, this.rival] = [mode, rival];
          buttons.forEach((other) => other.setAttribute("aria-pressed", `${other === button}`));
          this.want();
        });
        return button;
      });
      children.push(make("div", { class: "modes" }, ...buttons));
    }
    const { layout } = drawn;
    if (layout && layout.images.length > 1) {
      children.push(select("Image", layout.images.map(({ width, height }, number) => `${layout.maps?.[number]?.name ?? number}: ${width} x ${height}`), 0, (number) => {
        this.image = number;
        this.fit();
        this.want();
      }));
    }
    if (layout && layout.levels > 1) {
      const names = ["that fits", ...Array.from({ length: layout.levels }, (_, level) => `${level}`)];
      children.push(select("Mip level", names, 0, (number) => {
        this.level = number - 1;
        this.want();
      }));
    }
    if (!layout && this.terms > 0) {
      children.push(select("Terms", Array.from({ length: this.terms + 1 }, (_, terms) => (terms === 0 ? "mean alone" : `${terms}`)), this.terms, (number) => {
        this.terms = number;
        this.want();
      }));
    }
    if (texture.codec === "dct" && drawn.skippedLevels === 0) {
      const box = make("input", { type: "checkbox" }) as HTMLInputElement;
      box.addEventListener("change", () => {
        this.bits = box.checked;
        this.want();
      });
      children.push(make("label", {}, "Map of bits", box));
    }
    element("choices").replaceChildren(...children);
  }

  /** Draws in the next frame. */
  private want(): void {
    this.isWanted = true;
    if (!this.isDrawing) {
      this.isDrawing = true;
      requestAnimationFrame(() => void this.frame());
    }
  }

  private async frame(): Promise<void> {
    this.isWanted = false;
    if (this.shown || this.bank) {
      await (this.shown ? this.draw(this.shown) : this.drawBank(this.bank!));
      await this.gpu.device.queue.onSubmittedWorkDone();
      this.frames++;
    }
    this.isDrawing = false;
    if (this.isWanted) {
      this.want();
    }
  }

  /** Tiles in a picture of its own, which is copied: a canvas's texture lasts for a frame, pipelines may take longer to be made. */
  private async drawBank(bank: BankMap): Promise<void> {
    const [picture] = this.difference.targets(this.canvas.width, this.canvas.height);
    await bank.draw(picture, this.image, this.bankWindow, ground());
    this.copy(picture);
    element("split").hidden = true;
    this.map.getContext("2d")!.clearRect(0, 0, this.map.width, this.map.height);
  }

  private copy(picture: GPUTexture): void {
    const encoder = this.gpu.device.createCommandEncoder();
    encoder.copyTextureToTexture({ texture: picture }, { texture: this.context.getCurrentTexture() }, [this.canvas.width, this.canvas.height]);
    this.gpu.device.queue.submit([encoder.finish()]);
  }

  private async draw(shown: Shown): Promise<void> {
    const { gpu, canvas } = this, { drawn, window, orbit } = shown;
    const original = shown.originals[this.image];
    const isSplit = this.mode === "split" && original !== undefined;
    const line = element("split");
    line.hidden = !isSplit;
    line.style.left = `${100 * this.split}%`;
    const background = ground();
    if (orbit) {
      const viewProjection = orbit.viewProjection(canvas.width, canvas.height);
      await gpu.drawLight(drawn, this.context, { viewProjection, eye: orbit.eye, terms: this.terms, background });
      return;
    }
    const { x, y, scale } = window;
    const view: View = { image: this.image, x, y, scale, background };
    if (this.level >= 0) {
      view.level = this.level;
    }
    if (scale >= 2) {
      view.nearest = true;
    }
    const plain: View = { ...view, image: 0, level: 0 };
    if (this.mode === "error" && original) {
      const [one, other] = this.difference.targets(canvas.width, canvas.height);
      await gpu.draw(drawn, one, view);
      await gpu.draw(original, other, plain);
      this.difference.draw(this.context.getCurrentTexture());
    } else if (this.mode === "rival" && shown.rivals[this.rival]) {
      await gpu.draw(shown.rivals[this.rival]!.drawn, this.context, plain);
    } else if (this.mode === "original" && original) {
      await gpu.draw(original, this.context, plain);
    } else if (isSplit) {
      // In a picture of its own: a canvas's texture lasts for a frame, pipelines may take longer to be made.
      const [picture] = this.difference.targets(canvas.width, canvas.height);
      await gpu.draw(original, picture, plain);
      await gpu.draw(drawn, picture, { ...view, from: Math.max(1, Math.round(this.split * canvas.width)) });
      this.copy(picture);
    } else {
      await gpu.draw(drawn, this.context, view);
    }
    this.drawMap(shown);
  }

  /** Superblocks from few bytes (clear) to the most of the image (red). */
  private drawMap({ texture, window }: Shown): void {
    const context = this.map.getContext("2d")!;
    context.clearRect(0, 0, this.map.width, this.map.height);
    const stage = texture.form.blocks.find(({ image, level }) => image === this.image && level === 0);
    if (!this.bits || !stage) {
      return;
    }
    const { columns, rows, side, bytes } = superblocksOf(stage), most = Math.max(1, ...bytes), { x, y, scale } = window;
    const first = (at: number): number => Math.max(0, Math.floor(at / side));
    for (let row = first(y); row < rows && (row * side - y) * scale < this.map.height; row++) {
      for (let column = first(x); column < columns && (column * side - x) * scale < this.map.width; column++) {
        const share = bytes[row * columns + column]! / most;
        context.fillStyle = `hsl(${60 - 60 * share} 100% 50% / ${0.75 * Math.sqrt(share)})`;
        context.fillRect((column * side - x) * scale, (row * side - y) * scale, side * scale, side * scale);
      }
    }
  }

  /** Shows a file, or why it cannot be shown. */
  async tryShow(item: Item): Promise<void> {
    try {
      element("still").hidden = true;
      await this.show(item);
    } catch (error) {
      if (!(error instanceof LoadError || error instanceof GpuError)) {
        throw error;
      }
      showStill(item, error.message);
    }
  }
}

/** What shows around images. */
function ground(): [number, number, number] {
  const gray = matchMedia("(prefers-color-scheme: dark)").matches ? 0.09 : 0.957;
  return [gray, gray, gray];
}

/** A choice among names. */
function select(label: string, names: string[], chosen: number, choose: (number: number) => void): HTMLElement {
  const options = names.map((name, number) => make("option", { value: `${number}`, ...(number === chosen ? { selected: "" } : {}) }, name));
  const box = make("select", { "aria-label": label }, ...options) as HTMLSelectElement;
  box.addEventListener("change", () => choose(Number(box.value)));
  return make("label", names.some((name) => name.length > 24) ? { class: "wide" } : {}, label, box);
}

/** A picture in the place of the texture, and why. */
function showStill(item: Item, why: string): void {
  const picture = item.still ? [make("img", { src: `data:image/png;base64,${item.still}`, alt: item.name })] : [];
  element("name").textContent = item.name;
  element("still").replaceChildren(...picture, make("p", {}, why));
  element("still").hidden = false;
}

const { items, groups = {}, isServed } = readData();
/** The file of the address's number; what stands for a file where there is none. */
const first: Item = items[Number(location.hash.slice(1))] ?? items[0] ?? { name: "Texfold", data: new Uint8Array(0), originals: [] };
try {
  const gpu = await Gpu.create();
  void gpu.device.lost.then(({ message }) => showStill(first, `the GPU was lost; load the page again. ${message}`));
  const page = new Page(gpu, items, groups);
  Object.assign(globalThis, { page });
  listenForFiles(isServed, page);
  if (items.length > 0) {
    await page.tryShow(first);
  } else {
    showStill(first, isServed ? "Drop an image or a .txf file here." : "Drop a .txf file here.");
  }
} catch (error) {
  if (!(error instanceof GpuError)) {
    throw error;
  }
  showStill(first, error.message);
  if (items.length > 0) {
    showFacts(await open(fileOf(first)), null);
  }
}
