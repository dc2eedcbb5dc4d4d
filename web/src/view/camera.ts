// Where the page looks: a rectangle of an image, or around a mesh.

/** A place of the canvas, in its own pixels. */
export interface Place {
  x: number;
  y: number;
}

/** A part of an image: its column and row at the upper left corner, and pixels a texel. */
export class Window {
  x = 0;
  y = 0;
  scale = 1;

  /** Shows the whole of `width` x `height` texels. */
  fit(width: number, height: number, canvas: HTMLCanvasElement): void {
    this.scale = Math.min(canvas.width / width, canvas.height / height);
    this.centre(width / 2, height / 2, canvas);
  }

  centre(x: number, y: number, canvas: HTMLCanvasElement): void {
    this.x = x - canvas.width / this.scale / 2;
    this.y = y - canvas.height / this.scale / 2;
  }

  move(across: number, down: number): void {
    this.x -= across / this.scale;
    this.y -= down / this.scale;
  }

  /** Zooms by a factor; what is at `at` stays there. */
  zoom(factor: number, at: Place): void {
    const scale = Math.min(64, Math.max(1 / 256, this.scale * factor));
    this.x += at.x / this.scale - at.x / scale;
    this.y += at.y / this.scale - at.y / scale;
    this.scale = scale;
  }
}

type Vector = [number, number, number];
const minus = (a: Vector, b: Vector): Vector => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
const dot = (a: Vector, b: Vector): number => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a: Vector, b: Vector): Vector => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const unit = (a: Vector): Vector => a.map((value) => value / Math.hypot(...a)) as Vector;

/** A camera on a sphere around a mesh, y up. */
export class Orbit {
  private turn = 0.6;
  private tilt = 0.3;
  private distance: number;

  constructor(private readonly centre: Vector, private readonly radius: number) {
    this.distance = 2.6 * radius;
  }

  move(across: number, down: number): void {
    this.turn -= across * 0.008;
    this.tilt = Math.min(1.5, Math.max(-1.5, this.tilt + down * 0.008));
  }

  zoom(factor: number): void {
    this.distance = Math.min(20 * this.radius, Math.max(1.05 * this.radius, this.distance / factor));
  }

  get eye(): Vector {
    const [x, y, z] = this.centre, flat = Math.cos(this.tilt) * this.distance;
    return [x + flat * Math.sin(this.turn), y + this.distance * Math.sin(this.tilt), z + flat * Math.cos(this.turn)];
  }

  /** From the mesh's space to clip space with depths 0 to 1, column by column. */
  viewProjection(width: number, height: number): number[] {
    const { eye } = this, back = unit(minus(eye, this.centre)), right = unit(cross([0, 1, 0], back)), up = cross(back, right);
    const focal = 2, near = Math.max(this.radius / 1000, this.distance - 1.5 * this.radius), far = this.distance + 1.5 * this.radius;
    const across = focal * Math.min(1, height / width), down = focal * Math.min(1, width / height), depth = far / (near - far);
    const row = (axis: Vector, factor: number): number[] => [...axis.map((value) => value * factor), -dot(axis, eye) * factor];
    const rows = [row(right, across), row(up, down), row(back, depth), row(back, -1)];
    rows[2]![3]! += near * depth;
    return Array.from({ length: 16 }, (_, number) => rows[number % 4]![number >> 2]!);
  }
}
