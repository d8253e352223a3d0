// Turning, moving and zooming the viewpoint about a point. Drag: turn; right button or shift: move; wheel or pinch: zoom.

const TOP = Math.PI / 2 - 0.001;

export class Orbit {
  constructor(camera, element, onChange) {
    Object.assign(this, { camera, element, onChange, target: [0, 0, 0], azimuth: 0, elevation: 0.5, distance: 15 });
    this.pointers = new Map();
    element.addEventListener("pointerdown", (e) => this.#down(e));
    element.addEventListener("pointermove", (e) => this.#move(e));
    for (const end of ["pointerup", "pointercancel"]) element.addEventListener(end, (e) => this.#up(e));
    element.addEventListener("wheel", (e) => { e.preventDefault(); this.zoom(Math.exp(e.deltaY * 0.001)); },
      { passive: false });
    element.addEventListener("contextmenu", (e) => e.preventDefault());
  }

  get dragging() { return this.pointers.size > 0; }

  set({ target, azimuth, elevation, distance }) {
    if (target) this.target = target.slice();
    this.azimuth = azimuth ?? this.azimuth;
    this.elevation = Math.min(TOP, Math.max(-TOP, elevation ?? this.elevation));
    this.distance = Math.min(500, Math.max(0.5, distance ?? this.distance));
    this.apply();
  }

  zoom(factor) { this.set({ distance: this.distance * factor }); }

  apply() {
    const c = Math.cos(this.elevation), [x, y, z] = this.target;
    this.camera.position.set(x + this.distance * c * Math.sin(this.azimuth),
      y + this.distance * Math.sin(this.elevation), z + this.distance * c * Math.cos(this.azimuth));
    this.camera.lookAt(x, y, z);
    this.camera.updateMatrixWorld(); // for rays through the pointer before the next drawing
    this.onChange();
  }

  #down(e) {
    this.element.setPointerCapture(e.pointerId);
    this.pointers.set(e.pointerId, { x: e.clientX, y: e.clientY, pan: e.button === 2 || e.shiftKey });
  }

  #up(e) { this.pointers.delete(e.pointerId); }

  #move(e) {
    const last = this.pointers.get(e.pointerId);
    if (!last) return;
    const dx = e.clientX - last.x, dy = e.clientY - last.y;
    if (this.pointers.size === 2) this.#pinch(e, last);
    else if (last.pan) this.#pan(dx, dy);
    else this.set({ azimuth: this.azimuth - dx * 0.006, elevation: this.elevation + dy * 0.006 });
    Object.assign(last, { x: e.clientX, y: e.clientY });
  }

  #pinch(e, last) {
    const other = [...this.pointers].find(([id]) => id !== e.pointerId)[1];
    const before = Math.hypot(last.x - other.x, last.y - other.y);
    this.zoom(before / Math.max(1, Math.hypot(e.clientX - other.x, e.clientY - other.y)));
  }

  #pan(dx, dy) {
    const scale = (2 * this.distance * Math.tan((this.camera.fov * Math.PI) / 360)) / this.element.clientHeight;
    const e = this.camera.matrixWorld.elements; // its columns are the viewpoint's right and up
    this.set({ target: this.target.map((v, k) => v - dx * scale * e[k] + dy * scale * e[4 + k]) });
  }
}
