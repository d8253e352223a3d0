// The page: reads the embedded data, wires the controls, shows one frame at a time.

import * as THREE from "three";
import { Orbit } from "viewer/orbit";
import { FrameScene } from "viewer/scene";
import { KEPT, Live } from "viewer/live";
import { DepthPanel } from "viewer/depth";
import { gltf, save } from "viewer/exports";
import { showBanner, showFacts } from "viewer/facts";
import { drawLegend, offer } from "viewer/legend";
import { Measure, pick } from "viewer/measure";
import { showPilot } from "viewer/pilot";
import { drawStrip, nextBlind } from "viewer/timeline";
import * as model from "viewer/model";

const $ = (id) => document.getElementById(id);
const VIEWS = {
  behind: { azimuth: 0, elevation: 0.42, distance: 13 },
  top: { azimuth: 0, elevation: Math.PI / 2, distance: 24 },
  side: { azimuth: Math.PI / 2, elevation: 0.06, distance: 20 },
  eye: { azimuth: 0, elevation: 0.02, distance: 0.6 },
};
const SWITCHES = ["ground", "free", "unknown", "trail", "inferred", "labels", "numbers", "normals", "points", "tracks", "merged", "team"];
const CHOICES = ["what", "by", "layers", "world"];
const PRESSED = "button, summary, input[type=checkbox]"; // what space presses while it has the focus of the keyboard
const AHEAD = { behind: 4, top: 8, side: 7, eye: 0.6 };

async function unpack(text) {
  const bytes = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
  return JSON.parse(await new Response(stream).text());
}

class App {
  /** live: the connection to a service, null for a log. */
  constructor(data, live = null) {
    Object.assign(this, { data, live, at: 0, camera: live ? 0 : -1, playing: Boolean(live) });
    this.view = "behind";
    this.chosen = data.cameras[this.camera]?.name; // of a live page: what it follows, also if the order of the cameras changes
    THREE.ColorManagement.enabled = false; // the colours of the scale are final
    this.renderer = new THREE.WebGLRenderer({ canvas: $("canvas"), antialias: true, preserveDrawingBuffer: true });
    this.renderer.outputColorSpace = THREE.LinearSRGBColorSpace;
    this.eye = new THREE.PerspectiveCamera(55, 1, 0.05, 1000);
    this.frames = new FrameScene(data);
    this.measure = new Measure(this.frames.scene);
    this.orbit = new Orbit(this.eye, $("canvas"), () => this.ask());
    $("canvas").addEventListener("webglcontextlost", () => complain(new Error("the graphics card has dropped the drawing")));
    this.depth = new DepthPanel(data);
    offer("tracks", data.frames.some((frame) => frame.tracks), data);
    this.#controls();
    this.#fromAddress();
    new ResizeObserver(() => this.#resize()).observe($("stage"));
    this.#resize();
    this.look(this.view);
    this.show(this.at);
  }

  /** Requests one drawing at the next refresh. */
  ask() {
    if (this.asked) return;
    this.asked = true;
    requestAnimationFrame(() => {
      this.asked = false;
      this.#draw();
    });
  }

  #draw() {
    this.renderer.render(this.frames.scene, this.eye);
    this.frames.release();
    document.body.dataset.drawn = String(this.at);
  }

  get options() {
    const chosen = CHOICES.map((id) => [id, $(id).value]), on = SWITCHES.map((id) => [id, $(id).checked]);
    return Object.fromEntries([...chosen, ...on]);
  }

  place(frame) {
    const { frames } = this.data, last = (key) => {
      for (let k = this.at; k >= 0; k--) if (frames[k][key]) return frames[k];
    };
    return model.worldFromLevel(frame, this.options.world, last("pos")?.pos, last("attitude")?.heading);
  }

  /** The frame whose attitude is that of now: the newest with one, of any camera, unless it is older than the newest by a second. */
  attitude() {
    const { frames } = this.data, newest = frames.at(-1), known = frames.findLast((frame) => frame.attitude);
    return known && newest.t - known.t < 1 ? known : newest;
  }

  /** Sets the viewpoint to one of VIEWS, about a point ahead of the vehicle. */
  look(name) {
    this.view = name;
    const frame = this.data.frames[this.at], place = this.place(frame), view = VIEWS[name];
    const ahead = model.toDrawing(model.toWorld([AHEAD[name], 0, name === "eye" ? frame.cam[2] : 0], place));
    this.orbit.set({ ...view, azimuth: view.azimuth - place.yaw, target: ahead });
    this.anchor = place;
  }

  async show(k) {
    this.at = Math.min(this.data.frames.length - 1, Math.max(0, k));
    const frame = this.data.frames[this.at], options = this.options, place = this.place(frame);
    this.#follow(place);
    this.#words(frame, options);
    $("slider").value = String(this.at);
    if (this.live) showPilot(this.live.update.service.autopilot, this.attitude());
    else if (this.data.frames.some((f) => f.autopilot)) showPilot(frame.autopilot, frame);
    this.frames.draw(frame, options, place, null, 0);
    this.ask();
    const image = await this.depth.image(frame);
    if (this.data.frames[this.at] !== frame) return;
    this.depth.draw(frame, image);
    if (options.points && image) this.frames.draw(frame, options, place, image.bytes, image.width);
    this.ask();
  }

  /** Moves the viewpoint with the vehicle, in the same direction of view. */
  #follow(place) {
    if (!this.anchor) return;
    const level = model.toLevel([-this.orbit.target[2], this.orbit.target[0], -this.orbit.target[1]], this.anchor);
    this.orbit.set({ azimuth: this.orbit.azimuth - (place.yaw - this.anchor.yaw),
      target: model.toDrawing(model.toWorld(level, place)) });
    this.anchor = place;
  }

  #words(frame, options) {
    const { data } = this;
    if (this.live) this.live.showState();
    else showBanner(frame);
    $("count").textContent = this.live ? $("count").textContent : `${this.at + 1} / ${data.frames.length}`;
    showFacts(frame, data.cameras[frame.c].name, options.world === "ned");
  }

  step(direction) {
    const { frames } = this.data, next = model.stepFrame(frames, this.at, direction, this.camera);
    if (this.live && next === model.stepFrame(frames, frames.length, -1, this.camera)) this.play(true);
    else if (next === this.at) this.play(false);
    else this.show(next);
  }

  /** Adds a frame of the service; the oldest is removed. */
  append(frame) {
    const { frames } = this.data;
    frames.push(frame);
    if (frames.length > KEPT || frames[0].gone) {
      this.depth.forget(frames.shift());
      this.at -= 1;
    }
    $("slider").max = String(frames.length - 1);
    if (frame.pos) $("world").disabled = false;
    if (frame.tracks) offer("tracks", true, this.data);
    drawStrip($("strip"), frames);
    if (this.playing && frame.c === this.camera) this.show(frames.length - 1);
    else if (this.at < 0) this.show(0);
    else $("slider").value = String(this.at);
  }

  /** Replaces the merged world: planes in whole centimetres of ned. */
  merged(planes) {
    this.planes = planes;
    this.frames.ned.setWorld(planes);
    this.ask();
  }

  /** Replaces the obstacles of other vehicles. */
  team(team) {
    this.frames.ned.setTeam(team);
    this.ask();
  }

  /** Removes all frames: another companion view has started, whose times and cameras have nothing in common with them. Until
   *  its first frame nothing is drawn. The camera that was chosen is followed again where it still exists. */
  forget() {
    const { data } = this, frame = data.frames[this.at];
    data.cameras.splice(0, data.cameras.length, data.cameras[frame.c]);
    data.frames.splice(0, data.frames.length, { ...frame, c: 0, gone: true, status: "BLIND", cause: "", facts: [], depth: null,
      attitude: null, pos: null, R: null, ground: null, tracks: null });
    this.camera = 0;
    this.depth.images.clear();
    this.updateCameras();
    this.play(true);
  }

  /** Shows the cameras after one was added or changed. */
  updateCameras() {
    const { cameras } = this.data, known = cameras.findIndex((camera) => camera?.name === this.chosen);
    if (this.live && known >= 0) this.camera = known;
    const option = (camera, k) => new Option(camera.name, String(k), false, k === this.camera);
    $("camera").replaceChildren(...cameras.flatMap((camera, k) => (camera ? [option(camera, k)] : [])));
    $("camera").parentElement.hidden = cameras.length < 2;
    drawLegend(this.data);
  }

  play(on) {
    this.playing = on;
    if (this.live) return this.#followLive(on);
    $("play").textContent = on ? "❚❚" : "▶";
    $("play").title = on ? "pause (space)" : "play (space)";
    if (!on) return;
    let frames = this.data.frames;
    if (model.stepFrame(frames, this.at, 1, this.camera) === this.at) this.show(0);
    const began = performance.now(), from = frames[this.at].t;
    const tick = () => {
      if (!this.playing || this.began !== began) return;
      const t = from + ((performance.now() - began) / 1000) * Number($("speed").value), k = model.frameAt(frames, t);
      if (k > this.at && (this.camera < 0 || frames[k].c === this.camera)) this.show(k);
      if (t > frames[frames.length - 1].t) return this.play(false);
      requestAnimationFrame(tick);
    };
    this.began = began;
    requestAnimationFrame(tick);
  }

  #followLive(on) {
    $("play").textContent = on ? "● live" : "▶ live";
    $("play").title = on ? "stop here (space)" : "back to now (space)";
    if (on) this.show(model.stepFrame(this.data.frames, this.data.frames.length, -1, this.camera));
    this.live.showState();
  }

  #controls() {
    const { data } = this;
    $("title").textContent = data.title;
    $("note").textContent = data.note;
    $("slider").max = String(data.frames.length - 1);
    $("slider").addEventListener("input", () => { this.play(false); this.show(Number($("slider").value)); });
    $("prev").addEventListener("click", () => { this.play(false); this.step(-1); });
    $("next").addEventListener("click", () => { this.play(false); this.step(1); });
    $("play").addEventListener("click", () => this.play(!this.playing));
    $("speed").addEventListener("change", () => this.playing && this.play(true));
    for (const id of ["what", "by", "layers", ...SWITCHES]) {
      $(id).addEventListener("change", () => { drawLegend(this.data); this.show(this.at); });
    }
    $("world").disabled = !data.frames.some((f) => f.pos);
    $("world").addEventListener("change", () => { this.look(this.view); this.show(this.at); });
    for (const name of Object.keys(VIEWS)) $(`view-${name}`).addEventListener("click", () => this.look(name));
    if (this.live) {
      this.updateCameras();
      this.play(true);
    } else data.cameras.forEach((camera, k) => $("camera").add(new Option(camera.name, String(k))));
    $("camera").parentElement.hidden = data.cameras.length < 2;
    $("camera").addEventListener("change", () => {
      this.camera = Number($("camera").value);
      this.chosen = data.cameras[this.camera]?.name;
      if (this.live) this.play(true);
      else if (this.camera >= 0 && data.frames[this.at].c !== this.camera) this.step(1);
    });
    this.#tools();
    addEventListener("keydown", (e) => this.#key(e));
    addEventListener("click", (e) => e.detail && e.target.matches?.(PRESSED) && e.target.blur()); // space is then the page's again
    $("canvas").addEventListener("pointermove", (e) => this.#hover(e));
    $("canvas").addEventListener("pointerleave", () => { $("tip").hidden = true; });
    $("depth").addEventListener("pointermove", (e) => this.#tip(e, this.depth.words(e)));
    $("depth").addEventListener("pointerleave", () => { $("tip").hidden = true; });
    drawLegend(this.data);
  }

  /** Strip, jump to the next blind moment, measuring, saving, the panel of small screens. */
  #tools() {
    const { frames } = this.data;
    new ResizeObserver(() => drawStrip($("strip"), frames)).observe($("strip"));
    $("strip").addEventListener("click", (e) => {
      const box = $("strip").getBoundingClientRect();
      this.play(false);
      this.show(Math.floor(((e.clientX - box.left) / box.width) * frames.length));
    });
    $("blind").addEventListener("click", () => this.jumpBlind());
    $("measure").addEventListener("click", () => this.toggleMeasure());
    $("canvas").addEventListener("click", (e) => this.#click(e));
    $("png").addEventListener("click", () => {
      this.renderer.render(this.frames.scene, this.eye);
      $("canvas").toBlob((blob) => save(blob, `${this.#name()}.png`));
    });
    $("gltf").addEventListener("click", () => save(new Blob([this.gltf()], { type: "model/gltf+json" }), `${this.#name()}.gltf`));
    $("panel").addEventListener("click", () => {
      const hidden = document.body.classList.toggle("narrow");
      $("panel").setAttribute("aria-expanded", String(!hidden));
    });
  }

  /** What is drawn of obstacles and trail as a glTF file. */
  gltf() {
    const { points, colors } = this.frames.faces;
    return gltf(points, colors, this.frames.trail, this.#name());
  }

  #name() {
    const frame = this.data.frames[this.at];
    return `${this.data.cameras[frame.c].name}_${frame.sequence}`;
  }

  /** Shows the begin of the next blind stretch; the button says where there is none. */
  jumpBlind() {
    const k = nextBlind(this.data.frames, this.at);
    if (k < 0) return void ($("blind").textContent = "none blind");
    $("blind").textContent = "next blind";
    this.play(false);
    this.show(k);
  }

  toggleMeasure() {
    const on = this.measure.toggle();
    $("measure").setAttribute("aria-pressed", String(on));
    $("measured").hidden = !on;
    $("measured").textContent = "measure: click the first point";
    this.ask();
  }

  #ray(e) {
    const box = $("canvas").getBoundingClientRect(), ray = new THREE.Raycaster();
    ray.setFromCamera(new THREE.Vector2(((e.clientX - box.left) / box.width) * 2 - 1,
      1 - ((e.clientY - box.top) / box.height) * 2), this.eye);
    return ray;
  }

  #click(e) {
    if (!this.measure.on) return this.#hover(e); // a finger has no pointer to hover with
    const frame = this.data.frames[this.at], place = this.place(frame);
    const point = pick(this.#ray(e), this.frames.walls, -(frame.cam[2] + (frame.ground ? frame.ground[0] : 0) + place.t[2]));
    if (point) $("measured").textContent = this.measure.add(point);
    this.ask();
  }

  #key(e) {
    if (e.target.matches?.("select, input:not([type=checkbox]):not([type=range])") || e.ctrlKey || e.metaKey || e.altKey) return;
    if (e.key === " " && e.target.matches?.(PRESSED)) return;
    const acts = { ArrowLeft: () => this.step(-1), ArrowRight: () => this.step(1), Home: () => this.show(0),
      End: () => (this.live ? this.play(true) : this.show(this.data.frames.length - 1)), " ": () => this.play(!this.playing),
      1: () => this.look("behind"), 2: () => this.look("top"), 3: () => this.look("side"), 4: () => this.look("eye"), b: () => this.jumpBlind(), m: () => this.toggleMeasure() };
    if (!acts[e.key]) return;
    e.preventDefault();
    if (e.key !== " " && this.playing && e.key.length > 1) this.play(false);
    acts[e.key]();
  }

  #tip(e, text) {
    const tip = $("tip");
    tip.hidden = !text;
    tip.textContent = text || "";
    const below = e.clientY + 14 + tip.offsetHeight < innerHeight;
    tip.style.left = `${Math.min(e.clientX + 14, innerWidth - 260)}px`;
    tip.style.top = `${below ? e.clientY + 14 : e.clientY - 14 - tip.offsetHeight}px`;
  }

  #hover(e) {
    if (this.orbit.dragging || !this.frames.walls) return this.#tip(e, "");
    const [hit] = this.#ray(e).intersectObject(this.frames.walls), frame = this.data.frames[this.at];
    const wall = hit && this.frames.shown[hit.faceIndex >> 1], heights = wall && model.wallHeights(wall, frame);
    this.#tip(e, wall && `plane ${wall.plane}: ${model.metres(wall.distance)} away; ${heights.bottom.toFixed(1)} to ${heights.top.toFixed(1)} m above`
      + ` the ${heights.from}; margin ${wall.margin.toFixed(2)} m; cluster ${wall.cluster}; ${wall.support} px; ${model.flagWords(wall.flags)}`);
  }

  /** #frame=12&view=top&world=ned&by=flags&what=planes&points=1 opens the page so. */
  #fromAddress() {
    const wants = new URLSearchParams(location.hash.slice(1));
    for (const id of CHOICES) {
      if ([...$(id).options].some((o) => o.value === wants.get(id)) && !$(id).disabled) $(id).value = wants.get(id);
    }
    for (const id of SWITCHES) {
      if (wants.has(id)) $(id).checked = wants.get(id) === "1";
    }
    this.at = Math.min(this.data.frames.length - 1, Math.max(0, Number(wants.get("frame")) || 0));
    if (VIEWS[wants.get("view")]) this.view = wants.get("view");
    drawLegend(this.data);
  }

  #resize() {
    const { clientWidth: w, clientHeight: h } = $("stage");
    this.renderer.setPixelRatio(Math.min(2, devicePixelRatio));
    this.renderer.setSize(w, h, false);
    this.eye.aspect = w / Math.max(1, h);
    this.eye.updateProjectionMatrix();
    this.frames.labels.fit(this.frames.scene, h, this.eye.fov);
    drawLegend(this.data);
    if (document.body.dataset.drawn === undefined) this.ask();
    else this.#draw(); // at once: the new size has cleared the picture, and an empty one would look clear
  }
}

/** A page that follows a service always shows the state of the connection: its picture may be old. */
function complain(error) {
  if (window.live) window.live.broken ??= error instanceof Error ? error : new Error(String(error));
  $("banner").className = "blind";
  $("banner").textContent = `This page cannot be shown: ${error?.message ?? error}. It needs a browser of 2023 or later with WebGL.`;
}

addEventListener("error", (e) => complain(e.error ?? e.message));
addEventListener("unhandledrejection", (e) => complain(e.reason));
const data = await unpack($("data").textContent);
if (data.live) window.live = new Live(data, (live) => (window.app = new App(data, live)));
else window.app = new App(data);
