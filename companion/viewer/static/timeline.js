// The strip along the slider: which frames are valid, blind or without results; and the jump to the next blind moment.

const COLORS = { VALID: "#43a047", BLIND: "#e53935" }, OTHER = "#b26a00";

/** Index of the first frame of the next blind stretch after `at`, going round; -1 without one. */
export function nextBlind(frames, at) {
  const begins = (k) => frames[k].status === "BLIND" && (k === 0 || frames[k - 1].status !== "BLIND");
  for (let i = 1; i <= frames.length; i++) {
    const k = (at + i) % frames.length;
    if (begins(k)) return k;
  }
  return -1;
}

/** One letter per column of a strip `width` px wide: the worst frame in it (blind before others before valid). */
export function columns(frames, width) {
  const worst = new Array(Math.min(width, frames.length)).fill("VALID");
  frames.forEach((frame, k) => {
    const at = Math.min(worst.length - 1, Math.floor((k * worst.length) / frames.length));
    if (frame.status === "BLIND" || (frame.status !== "VALID" && worst[at] === "VALID")) worst[at] = frame.status;
  });
  return worst;
}

export function drawStrip(canvas, frames) {
  const width = Math.max(1, Math.round(canvas.clientWidth * Math.min(2, devicePixelRatio)));
  if (canvas.width !== width) canvas.width = width;
  const pen = canvas.getContext("2d"), worst = columns(frames, width);
  pen.clearRect(0, 0, canvas.width, canvas.height);
  worst.forEach((status, k) => {
    const from = Math.floor((k * width) / worst.length), to = Math.floor(((k + 1) * width) / worst.length);
    pen.fillStyle = COLORS[status] ?? OTHER;
    pen.fillRect(from, 0, Math.max(1, to - from), canvas.height);
  });
}
