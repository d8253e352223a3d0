// A page that follows a service: sends one request after another to its server, and always shows the age of its picture. With
// any fault (of the service, the server, the connection or this page) the age increases, and a picture that is too old is marked
// across the page.

import { cssColor, teamColor } from "viewer/ned";
import { offer } from "viewer/legend";
import { showPilot } from "viewer/pilot";

const CUT_MS = 1000, OLD_S = 1, OLD_REPORT_S = 3, REQUEST_TIMEOUT_MS = 3000, RETRY_MS = 300, SHOW_STATE_MS = 100;
export const KEPT = 300;
const $ = (id) => document.getElementById(id);
const wait = (ms) => new Promise((done) => setTimeout(done, ms));

/** "0.2 s", "14 s", "3 min". */
export function span(seconds) {
  if (seconds < 10) return `${seconds.toFixed(1)} s`;
  return seconds < 120 ? `${Math.round(seconds)} s` : `${Math.round(seconds / 60)} min`;
}

/** The state that the page shows: {state, word, text, age}. state: valid, blind, stale, cut, waiting or paused; word: large across
 *  the page, "" for none. seen: {answer_ms: since an answer came, null before the first; since_s: of its ages at most; update: that answer;
 *  shown_s: how old the frame is that is drawn, null without; following: whether it is meant to be the newest}. */
export function verdict(seen, stale_s) {
  const { update, since_s } = seen, warning = "Do not treat any direction as free.";
  if (seen.answer_ms === null) return { state: "waiting", word: "", text: seen.trouble ? `companion view does not answer: ${seen.trouble}` : "Waiting for the first answer of companion view…" };
  if (seen.answer_ms > CUT_MS) {
    return { state: "cut", word: "CUT OFF", text: `CUT OFF: companion view has not answered for ${span(seen.answer_ms / 1000)}`
      + ` (${seen.trouble || "no answer"}). What is shown is old. ${warning}` };
  }
  if (!update.cameras.length) return { state: "blind", word: "BLIND", text: `BLIND: ${update.service.missing[0] || "no camera is known"}. ${warning}` };
  const ages = update.cameras.map((c) => (c.age_s === null ? Infinity : c.age_s + since_s));
  const blind = update.cameras.map((c) => c.blind || (c.age_s === null ? "no frame yet" : ""));
  const texts = update.cameras.map((c, k) => blind[k] && (update.cameras.length > 1 ? `${c.name}: ${blind[k]}` : blind[k])).filter(Boolean);
  const age = Math.max(...ages);
  if (texts.length) return { state: "blind", word: "BLIND", text: `BLIND: ${texts.join("; ")}. ${warning}`, blind };
  if (age > stale_s) {
    return { state: "stale", word: "STALE", text: `STALE: the newest exposure known to this page is ${span(age)} old; companion view,`
      + ` the network or this page is slow. ${warning}`, blind, age };
  }
  if (seen.shown_s === null) return { state: "waiting", word: "", text: "Waiting for the first frame…", blind, age };
  if (!seen.following) return { state: "paused", word: "", text: "NOT LIVE (▶ live, space or End: back to now)", blind, age };
  if (seen.shown_s > OLD_S) {
    return { state: "stale", word: "STALE", text: `STALE: what is shown is ${span(seen.shown_s)} old, although newer frames exist. ${warning}`, blind, age };
  }
  return { state: "valid", word: "", text: "VALID", blind, age };
}

export class Live {
  /** open: makes the app, called with the first frame. */
  constructor(data, open) {
    Object.assign(this, { data, open, app: null, name: "", after: 0, world: 0, team: 0, update: null, answered: null, made: 0, trouble: "", broken: null });
    $("service").hidden = false;
    $("title").textContent = data.title;
    $("speed").hidden = true;
    $("hint").textContent = $("hint").textContent.replace("space: play", "← and space: stop, End: now");
    setInterval(() => this.showState(), SHOW_STATE_MS);
    document.addEventListener("visibilitychange", () => this.showState()); // a page that was suspended shows its age first
    this.#ask();
  }

  async #ask() {
    for (;;) {
      const asked = performance.now();
      let update = null;
      try {
        const reply = await fetch(`update?name=${encodeURIComponent(this.name)}&after=${this.after}&world=${this.world}&team=${this.team}`,
          { cache: "no-store", signal: AbortSignal.timeout(REQUEST_TIMEOUT_MS) });
        if (!reply.ok) throw new Error(`${reply.status} ${(await reply.text()).trim()}`);
        update = await reply.json();
      } catch (error) {
        this.trouble = error?.name === "TimeoutError" ? "it does not answer" : String(error?.message ?? error);
        await wait(RETRY_MS);
        continue;
      }
      try {
        this.#take(update, asked);
      } catch (error) {
        this.broken ??= error;
        throw error;
      }
    }
  }

  /** asked: when the request was sent; the answer was made at least held_ms later, so no age is shown too small. */
  #take(update, asked) {
    if (update.name !== this.name) { // another server, which numbers its answers anew
      this.name = update.name;
      this.app?.forget();
    }
    Object.assign(this, { update, after: update.number, answered: performance.now(), made: asked + update.held_ms, trouble: "" });
    update.cameras.forEach((c, k) => { if (c.info) this.#describe(c.info, k); });
    for (const frame of update.frames) {
      if (this.app) this.app.append(frame);
      else {
        this.data.frames.push(frame);
        this.app = this.open(this);
      }
    }
    if (update.world.planes && this.app) {
      this.world = update.world.number;
      this.app.merged(update.world.planes);
    }
    this.#team(update.team);
    this.showState();
    this.#service(update.service);
    if (this.app) showPilot(update.service.autopilot, this.app.attitude());
    offer("merged", update.world.received, this.data);
    $("worldwords").textContent = !update.world.received ? "" : update.world.cause ? `merged world: not usable, ${update.world.cause}`
      : `merged world: ${update.world.total} planes`;
  }

  /** Obstacles of other vehicles: the picture, and who contributed what. */
  #team(team) {
    if (team.planes && this.app) {
      this.team = team.number;
      this.app.team(team);
    }
    $("team").parentElement.hidden = $("members").hidden = !team.received;
    const lines = team.members.map(({ vehicle, silent_s, text }) => {
      const line = Object.assign(document.createElement("div"), { textContent: `vehicle ${vehicle}, last packet ${span(silent_s)} ago: ${text}` });
      line.style.setProperty("--mark", cssColor(teamColor(vehicle)));
      return line;
    });
    $("members").replaceChildren(...(lines.length ? lines : [team.silent ? "other vehicles: the service publishes no team any more" : "other vehicles: none received"]));
  }

  /** Takes the description of a camera. */
  #describe(info, k) {
    const known = this.data.cameras[k];
    if (JSON.stringify(known) === JSON.stringify(info)) return;
    this.data.cameras[k] = info;
    this.app?.updateCameras();
  }

  /** The banner and the large word; ten times a second, whether or not anything came. */
  showState() {
    const now = performance.now(), { app } = this;
    const drawn = app?.data.frames[app.at], shown = drawn?.gone ? undefined : drawn, newest_s = shown && this.update.cameras[shown.c]?.shown_s;
    const since_s = (now - this.made) / 1000, last = shown && app.data.frames.findLast((f) => f.c === shown.c);
    const shown_s = typeof newest_s === "number" ? newest_s + since_s + (last.t - shown.t) : null;
    const v = this.broken ? { state: "cut", word: "BROKEN", text: `BROKEN: this page has failed (${this.broken.message}). What is shown is old; reload the page.` }
      : verdict({ update: this.update, since_s, trouble: this.trouble, answer_ms: this.answered === null ? null : now - this.answered,
        shown_s, following: !app || app.playing }, this.data.live.stale_s);
    const blind = v.state === "blind" && shown && v.blind ? v.blind[shown.c] : v.word;
    $("banner").className = { valid: "valid", waiting: "empty", paused: "empty" }[v.state] || "blind";
    $("banner").textContent = v.text;
    const age = document.createElement("span");
    age.id = "age";
    age.textContent = shown_s === null || (shown.status === "BLIND" && !shown.depth) ? "" : v.state === "valid" ? `${span(shown_s)} old` : `picture ${span(shown_s)} old`;
    $("banner").append(age);
    $("stage").classList.toggle("blind", Boolean(blind));
    $("stage").dataset.word = v.word;
    $("depth").classList.toggle("old", v.state === "cut" || v.state === "stale" || shown_s > OLD_S);
    const report_s = this.update?.service.age_s;
    $("service").classList.toggle("old", v.state === "cut" || (typeof report_s === "number" && report_s + since_s > OLD_REPORT_S));
    Object.assign(document.body.dataset, { state: v.state, shown: shown_s === null ? "" : shown_s.toFixed(3) });
    if (app) $("count").textContent = app.playing ? "live" : shown ? `−${span(Math.max(0, last.t - shown.t))}` : "";
  }

  #service(service) {
    const line = (text) => Object.assign(document.createElement("div"), { textContent: text, className: text.startsWith("  !") ? "trouble" : "" });
    const found = service.lines.findIndex((text) => text.startsWith("frames:")), at = found < 0 ? service.lines.length : found;
    $("health").replaceChildren(...service.lines.slice(0, at).map(line));
    $("more").replaceChildren(...service.lines.slice(at).map(line));
    $("missing").replaceChildren(...service.missing.map((text) => Object.assign(document.createElement("li"), { textContent: text })));
  }
}
