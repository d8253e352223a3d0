// Text in the picture: sprites of one size on the screen, whose textures are kept for the next frame.

import * as THREE from "three";

const KEPT = 120;
const LEAST_PX = 16; // of a label on the screen: letters of 12 px

export class Labels {
  constructor() {
    this.textures = new Map(); // text, colour -> texture, the latest used last
    this.least = 0; // share of the picture's height
  }

  /** Sets the size of the picture, in which no label of the scene is lower than LEAST_PX. */
  fit(scene, height_px, fov_deg) {
    this.least = (LEAST_PX * 2 * Math.tan((fov_deg * Math.PI) / 360)) / Math.max(1, height_px);
    scene.traverse((object) => object.isSprite && this.#scale(object));
  }

  /** A sprite. at: in the drawing; size: of the text, as a share of the picture's height; larger in a low picture; rows: heights
   *  of it between the point and its middle. */
  sprite(text, at, color, size, rows = 0) {
    const map = this.#texture(text, color);
    const sprite = new THREE.Sprite(new THREE.SpriteMaterial({ map, depthTest: false, sizeAttenuation: false }));
    sprite.name = text;
    sprite.userData.size = size;
    sprite.center.y -= rows;
    this.#scale(sprite);
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

  #scale(sprite) {
    const { width, height } = sprite.material.map.image, size = Math.max(sprite.userData.size, this.least);
    sprite.scale.set((size * width) / height, size, 1);
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
