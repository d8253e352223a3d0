// Text in the picture: sprites of one size on the screen, whose textures are kept for the next frame.

import * as THREE from "three";

const KEPT = 120;

export class Labels {
  constructor() {
    this.textures = new Map(); // text, colour -> texture, the latest used last
  }

  /** A sprite. at: in the drawing; size: of the text, as a share of the picture's height. */
  sprite(text, at, color, size) {
    const map = this.#texture(text, color), { width, height } = map.image;
    const sprite = new THREE.Sprite(new THREE.SpriteMaterial({ map, depthTest: false, sizeAttenuation: false }));
    sprite.scale.set((size * width) / height, size, 1);
    sprite.position.set(...at);
    sprite.renderOrder = 10;
    return sprite;
  }

  /** Disposes of the textures that were not used for longest. */
  release() {
    while (this.textures.size > KEPT) {
      const [key, map] = this.textures.entries().next().value;
      this.textures.delete(key);
      map.dispose();
    }
  }

  #texture(text, color) {
    const key = `${text} ${color}`, known = this.textures.get(key);
    if (known) {
      this.textures.delete(key);
      this.textures.set(key, known);
      return known;
    }
    const canvas = document.createElement("canvas"), pen = canvas.getContext("2d"), font = "600 44px sans-serif";
    pen.font = font;
    canvas.width = Math.ceil(pen.measureText(text).width) + 24;
    canvas.height = 60;
    pen.font = font;
    pen.fillStyle = "rgba(0,0,0,0.6)";
    pen.fillRect(0, 0, canvas.width, canvas.height);
    pen.fillStyle = color;
    pen.textBaseline = "middle";
    pen.fillText(text, 12, 32);
    const map = new THREE.CanvasTexture(canvas);
    this.textures.set(key, map);
    return map;
  }
}
