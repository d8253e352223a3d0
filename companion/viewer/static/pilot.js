// The autopilot's state: mode, armed, and the obstacle distances by direction, as sent and as the autopilot sent them back.

const $ = (id) => document.getElementById(id);
const UNKNOWN = "#59636e", CLEAR = "#2e7d32", OLD_S = 3;
const NEAR_CM = 200, FAR_CM = 1500;

/** Colour of a distance in cm: grey unknown (null), green clear, otherwise red (near) to yellow (far). */
export function sectorColor(cm, clear) {
  if (cm === null) return UNKNOWN;
  if (clear && cm >= clear) return CLEAR;
  const share = Math.min(1, Math.max(0, (cm - NEAR_CM) / (FAR_CM - NEAR_CM)));
  return `hsl(${Math.round(55 * share)} 95% 52%)`;
}

/** Mode and armed state in words; pilot: of a frame or of the live service, null: not known. */
export function pilotWords(pilot) {
  if (!pilot) return { text: "autopilot: no report yet", armed: false };
  const old = pilot.age_s > OLD_S ? ` (${Math.round(pilot.age_s)} s ago)` : "";
  return { text: `${pilot.kind} · ${pilot.mode || "mode unknown"} · ${pilot.armed ? "ARMED" : "disarmed"}${old}`, armed: pilot.armed };
}

/** Why a ring of sectors is not drawn; "": it is. heading: of the vehicle, null: not known. */
export function ringGap(ring, heading) {
  if (!ring) return "none";
  if (ring.age_s > OLD_S) return `none for ${Math.round(ring.age_s)} s`;
  return ring.body || heading !== null ? "" : "not drawn: it counts from north, and the heading is not known";
}

/** What a ring of sectors says in words. */
export function ringWords(ring, heading) {
  const gap = ringGap(ring, heading);
  if (gap) return gap;
  const obstacles = ring.cm.filter((cm) => cm !== null && !(ring.clear && cm >= ring.clear));
  const unknown = ring.cm.filter((cm) => cm === null).length;
  if (unknown === ring.cm.length) return `all ${unknown} unknown`;
  const nearest = obstacles.length ? `nearest ${(Math.min(...obstacles) / 100).toFixed(1)} m` : "no obstacle";
  return `${nearest}; ${unknown} of ${ring.cm.length} unknown`;
}

/** Draws the state. frame: of the same time, for rings that count from north. */
export function showPilot(pilot, frame) {
  const heading = frame.attitude ? frame.heading : null;
  const words = pilotWords(pilot);
  $("pilot").textContent = words.text;
  $("pilot").classList.toggle("armed", words.armed);
  $("sectors").hidden = !pilot || !(pilot.sent || pilot.echoed); // with [avoid] send = false there are none
  if (!pilot) return;
  const pen = $("dial").getContext("2d"), { width: w, height: h } = $("dial");
  pen.clearRect(0, 0, w, h);
  ring(pen, w / 2, h / 2, 0.36 * w, 0.48 * w, pilot.sent, heading);
  ring(pen, w / 2, h / 2, 0.20 * w, 0.32 * w, pilot.echoed, heading);
  pen.fillStyle = "#ffd54f";
  pen.beginPath();
  for (const [x, y] of [[0, -0.09], [0.06, 0.07], [0, 0.03], [-0.06, 0.07]]) pen.lineTo(w / 2 + x * w, h / 2 + y * w);
  pen.fill();
  $("sentwords").textContent = ringWords(pilot.sent, heading);
  $("echowords").textContent = ringWords(pilot.echoed, heading);
}

/** Draws one ring about (x, y); grey where it is not current. sectors: null: none. heading: rad, null: not known. */
function ring(pen, x, y, inner, outer, sectors, heading) {
  const values = ringGap(sectors, heading) ? null : sectors;
  const n = values ? values.cm.length : 1, step = values ? (values.step * Math.PI) / 180 : 2 * Math.PI;
  const first = values ? (values.first * Math.PI) / 180 - (values.body ? 0 : heading) : 0;
  for (let k = 0; k < n; k++) {
    const middle = first + k * step - Math.PI / 2; // forward is up
    pen.beginPath();
    pen.arc(x, y, outer, middle - step / 2 + 0.008, middle + step / 2 - 0.008);
    pen.arc(x, y, inner, middle + step / 2 - 0.008, middle - step / 2 + 0.008, true);
    pen.closePath();
    pen.fillStyle = values ? sectorColor(values.cm[k], values.clear) : "#272f38";
    pen.fill();
  }
}
