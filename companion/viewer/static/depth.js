// The depth image beside the picture, with the outlines of the planes.

import * as model from "viewer/model";

const $ = (id) => document.getElementById(id);
const KEPT_IMAGES = 32;

export class DepthPanel {
  constructor(data) {
    Object.assign(this, { data, images: new Map(), picture: null, camera: null }); // images: frame -> decoded image
  }

  /** {bytes, width, height} of a frame's small depth image, null without one. */
  async image(frame) {
    if (!frame.depth) return null;
    if (!this.images.has(frame)) {
      if (this.images.size > KEPT_IMAGES) this.images.delete(this.images.keys().next().value);
      const picture = new Image();
      picture.src = `data:image/png;base64,${frame.depth}`;
      await picture.decode();
      const canvas = new OffscreenCanvas(picture.width, picture.height), pen = canvas.getContext("2d");
      pen.drawImage(picture, 0, 0);
      const rgba = pen.getImageData(0, 0, picture.width, picture.height).data;
      const bytes = new Uint8Array(rgba.length / 4);
      for (let i = 0; i < bytes.length; i++) bytes[i] = rgba[4 * i];
      this.images.set(frame, { bytes, width: picture.width, height: picture.height });
    }
    return this.images.get(frame);
  }

  forget(frame) { this.images.delete(frame); }

  /** Draws a frame's image, null: none. */
  draw(frame, image) {
    const canvas = $("depth"), pen = canvas.getContext("2d"), camera = this.data.cameras[frame.c];
    this.camera = camera;
    $("nodepth").hidden = image !== null;
    canvas.hidden = image === null;
    this.picture = image;
    if (image === null) return;
    const scale = Math.max(1, Math.round(640 / image.width));
    Object.assign(canvas, { width: image.width * scale, height: image.height * scale });
    const small = new ImageData(image.width, image.height);
    for (let i = 0; i < image.bytes.length; i++) {
      let color = model.paletteColor(this.data.palette, image.bytes[i]);
      const stripe = (((i % image.width) + Math.floor(i / image.width)) >> 2) & 1;
      if (image.bytes[i] === model.UNKNOWN && stripe) color = color.map((v) => v * 0.8);
      small.data.set([...color.map((v) => 255 * v), 255], 4 * i);
    }
    const source = new OffscreenCanvas(image.width, image.height);
    source.getContext("2d").putImageData(small, 0, 0);
    pen.imageSmoothingEnabled = false;
    pen.drawImage(source, 0, 0, canvas.width, canvas.height);
    if (frame.R && frame.status === "VALID") this.#outlines(pen, canvas.width / camera.width, frame, camera);
  }

  #outlines(pen, scale, frame, camera) {
    const walls = model.planeWalls(frame).sort((a, b) => b.distance - a.distance), thin = walls.length > 60 ? 0.6 : 1;
    for (const wall of walls) {
      const corners = model.corners(wall).map((p) => model.projectPixel(p, camera, frame));
      if (corners.includes(null)) continue;
      pen.beginPath();
      corners.forEach(([u, v]) => pen.lineTo((u + 0.5) * scale, (v + 0.5) * scale));
      pen.closePath();
      pen.setLineDash(wall.flags & model.INFERRED ? [7, 5] : []);
      for (const [color, width] of [["#000", 3 * thin], ["#fff", 1.4 * thin]]) Object.assign(pen, { strokeStyle: color, lineWidth: width }), pen.stroke();
    }
  }

  /** The depth under the pointer as text, "" without an image. */
  words(e) {
    const { picture, camera } = this, box = $("depth").getBoundingClientRect();
    if (!picture) return "";
    const u = Math.min(picture.width - 1, Math.floor(((e.clientX - box.left) / box.width) * picture.width));
    const v = Math.min(picture.height - 1, Math.floor(((e.clientY - box.top) / box.height) * picture.height));
    const byte = picture.bytes[v * picture.width + u];
    return byte === model.UNKNOWN ? "unknown: no measurement" : byte === model.FAR ? "free to the maximum range"
      : `about ${model.indexRange(byte, camera).toFixed(1)} m deep`;
  }
}
