// Texts of the shown frame: the banner of its state, and the table of facts.

const $ = (id) => document.getElementById(id);

/** Shows whether the frame is valid. */
export function showBanner(frame) {
  $("banner").className = { BLIND: "blind", VALID: "valid" }[frame.status] || "empty";
  $("banner").textContent = frame.status === "BLIND"
    ? `BLIND: ${frame.cause}. Do not treat any direction as free.` : frame.status === "VALID" ? "VALID"
      : "NO PRISMS in this log: run `companion replay` first";
  $("stage").classList.toggle("blind", frame.status === "BLIND");
}

/** Fills the table. camera: name; ned: whether the frame is drawn in the world. */
export function showFacts(frame, camera, ned) {
  const rows = [["camera", camera], ["frame", frame.sequence], ["time", `${frame.t.toFixed(2)} s`],
    ["attitude", frame.attitude ? `roll ${frame.attitude[0]}°, pitch ${frame.attitude[1]}°, yaw ${frame.attitude[2]}°`
    : ned ? "unknown: drawn with the last known heading" : "none"],
    ["position", frame.pos ? `${frame.pos.map((v) => v.toFixed(2)).join(", ")} m (north, east, down)`
      : ned ? "unknown: drawn at the last known one" : "none"], ...frame.facts];
  $("facts").replaceChildren(...rows.map(([name, value]) => {
    const row = document.createElement("tr");
    for (const [tag, text] of [["th", name], ["td", value]]) row.appendChild(document.createElement(tag)).textContent = text;
    return row;
  }));
}
