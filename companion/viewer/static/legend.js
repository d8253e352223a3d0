// The legend beside the picture: the scale of distances, the colours of the chosen colouring, and of what not every page has.

import * as model from "viewer/model";
import { cssColor, WORLD } from "viewer/ned";
import { FREE, GROUND, OPEN, UNKNOWN, VEHICLE } from "viewer/scene";
import { MOVING, STATIC } from "viewer/tracks";

const $ = (id) => document.getElementById(id);
const NUMBER_PX = 34;
const css = (color) => `rgb(${color.map((v) => Math.round(255 * v)).join(",")})`;
const ALWAYS = [["free", FREE], ["presumed free", OPEN], ["unknown", UNKNOWN], ["ground", GROUND], ["vehicle, trail", VEHICLE]]
  .map(([text, color]) => [text, cssColor(color)]);
/** Switches that only some pages have, and what they show: text, colour. */
const OPTIONAL = { merged: [["merged world", cssColor(WORLD)]], tracks: [["tracked", css(STATIC)], ["moving", css(MOVING)]] };

/** Shows or hides a switch that only some pages have, and what the legend says of it. */
export function offer(id, on, data) {
  if ($(id).parentElement.hidden === !on) return;
  $(id).parentElement.hidden = !on;
  drawLegend(data);
}

/** data: palette and cameras of the page. */
export function drawLegend(data) {
  const { palette, cameras } = data, by = $("by").value, camera = cameras.find((known) => known);
  if (!camera) return; // of a service whose cameras have not been described yet
  const sample = (flags) => css(model.wallColor({ flags }, "flags", camera, palette));
  const marks = { distance: [], cluster: [["one colour for each cluster", "#7aa"]],
    flags: [["measured", sample(0)], ["partly inferred", sample(1)], ["unknown behind", sample(2)], ["irregular", sample(64)]] }[by];
  const stops = Array.from({ length: 16 }, (_, k) => css(model.paletteColor(palette, 1 + Math.round((k * 253) / 15))));
  $("ramp").style.background = `linear-gradient(90deg, ${stops.join(",")})`;
  $("ramp").textContent = by === "distance" ? "obstacles by distance" : "depth image by distance";
  const apart = 100 * (NUMBER_PX / Math.max(1, $("ramp").clientWidth)); // per cent that a number needs
  let last = -Infinity;
  const shares = [camera.min_m, 1, 2, 5, 10, 20, 50].filter((m) => m >= camera.min_m && m <= camera.max_m)
    .map((m) => [m, ((model.rangeIndex(m, camera) - 1) / 253) * 100]).filter(([, share]) => share - last >= apart && ((last = share), true));
  const [before, end] = shares.slice(-2);
  if (end && end[1] - before[1] < 1.6 * apart) shares.splice(-2, 1); // the last number ends at the border instead of being centred
  $("ticks").replaceChildren(...shares.map(([m, share]) => {
    const tick = document.createElement("span");
    tick.textContent = `${m} m`;
    tick.style.left = `${share}%`;
    return tick;
  }));
  const present = Object.entries(OPTIONAL).flatMap(([id, shown]) => ($(id).checked && !$(id).parentElement.hidden ? shown : []));
  $("marks").replaceChildren(...[...marks, ...present, ...ALWAYS].map(([text, color]) => {
    const mark = document.createElement("span");
    mark.textContent = text;
    mark.style.setProperty("--mark", color);
    return mark;
  }));
}
