// Mouse, touch, wheel and keys as moves and zooms.

import type { Place } from "./camera.js";

/** What the page does with input, in pixels of the canvas. */
export interface Moves {
  move(across: number, down: number): void;
  zoom(factor: number, at: Place): void;
  key(key: string): boolean;
}

const STEP = 60;

/** Listens on the canvas. */
export function listen(canvas: HTMLCanvasElement, moves: Moves): void {
  const pointers = new Map<number, Place>();
  const placed = (event: PointerEvent | WheelEvent): Place => {
    const { left, top } = canvas.getBoundingClientRect(), ratio = canvas.width / canvas.clientWidth;
    return { x: (event.clientX - left) * ratio, y: (event.clientY - top) * ratio };
  };
  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    pointers.set(event.pointerId, placed(event));
  });
  canvas.addEventListener("pointermove", (event) => {
    const before = pointers.get(event.pointerId);
    if (!before) {
      return;
    }
    const now = placed(event), count = pointers.size;
    const other = [...pointers].find(([id]) => id !== event.pointerId)?.[1];
    pointers.set(event.pointerId, now);
    moves.move((now.x - before.x) / count, (now.y - before.y) / count);
    if (other) {
      const apart = (place: Place): number => Math.max(1, Math.hypot(place.x - other.x, place.y - other.y));
      moves.zoom(apart(now) / apart(before), { x: (now.x + other.x) / 2, y: (now.y + other.y) / 2 });
    }
  });
  for (const kind of ["pointerup", "pointercancel"] as const) {
    canvas.addEventListener(kind, (event) => pointers.delete(event.pointerId));
  }
  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    moves.zoom(2 ** (-event.deltaY / (event.deltaMode === 0 ? 300 : 8)), placed(event));
  }, { passive: false });
  canvas.addEventListener("keydown", (event) => {
    const arrows: Record<string, [number, number]> = { ArrowLeft: [STEP, 0], ArrowRight: [-STEP, 0], ArrowUp: [0, STEP], ArrowDown: [0, -STEP] };
    const arrow = arrows[event.key], middle = { x: canvas.width / 2, y: canvas.height / 2 };
    if (arrow) {
      moves.move(...arrow);
    } else if (event.key === "+" || event.key === "=") {
      moves.zoom(1.25, middle);
    } else if (event.key === "-") {
      moves.zoom(0.8, middle);
    } else if (!moves.key(event.key)) {
      return;
    }
    event.preventDefault();
  });
}
