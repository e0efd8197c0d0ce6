// Runs to watch (`.watch`) and maps to compare (`.compare-maps`). The JSON that a slot names is described at
// `RecordedRun` and `MapPair`. Text of others is set as text, never as markup.
(() => {
  "use strict";

  // ── What both share ──────────────────────────────────────────────────────────────────────────────────────────

  const stillness = matchMedia("(prefers-reduced-motion: reduce)");
  let isPrinting = false;
  const redraws = new Set();
  const redrawAll = () => redraws.forEach((redraw) => redraw());

  /** An element with properties (`aria-…`, `role` and `for` as attributes) and children. */
  const make = (tag, properties = {}, ...children) => {
    const element = document.createElement(tag);
    for (const [name, value] of Object.entries(properties)) {
      if (/^(aria-|role$|for$)/.test(name)) element.setAttribute(name, value);
      else element[name] = value;
    }
    element.append(...children);
    return element;
  };
  const option = (value, text) => make("option", { value: String(value), textContent: text });
  let names = 0;
  /** A control behind its label. */
  const labelled = (text, control) => {
    control.id ||= `watch-control-${(names += 1)}`;
    return make("span", { className: "watch-field" }, make("label", { htmlFor: control.id, textContent: text }), control);
  };

  /** Three digits that count, and thousands apart. */
  const digits = (value) => {
    if (!Number.isFinite(value)) return "–";
    if (value !== 0 && Math.abs(value) < 0.001) return value.toExponential(1);
    const places = Math.abs(value) >= 100 ? 0 : Math.abs(value) >= 10 ? 1 : Math.abs(value) >= 1 ? 2 : 3;
    return value.toLocaleString("en", { minimumFractionDigits: places, maximumFractionDigits: places });
  };

  /** Arrays as `Packer` puts them: all first bytes, then all second ones. */
  class Planes {
    static async of(base64) {
      const packed = Uint8Array.from(atob(base64), (character) => character.charCodeAt(0));
      const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"));
      return new Planes(new Uint8Array(await new Response(stream).arrayBuffer()));
    }
    constructor(bytes) {
      this.bytes = bytes;
      this.at = 0;
    }
    take(Kind, count) {
      const width = Kind.BYTES_PER_ELEMENT;
      const joined = new Uint8Array(count * width);
      for (let byte = 0; byte < width; byte += 1) {
        for (let i = 0; i < count; i += 1) joined[i * width + byte] = this.bytes[this.at + byte * count + i];
      }
      this.at += count * width;
      return new Kind(joined.buffer);
    }
  }

  /** Whether the page around an element is dark: its text is light. */
  const isDark = (element) => {
    if (isPrinting) return false;
    const [red, green, blue] = getComputedStyle(element).color.match(/[\d.]+/g).map(Number);
    return 0.299 * red + 0.587 * green + 0.114 * blue > 128;
  };
  // The palette of Okabe and Ito, lighter on dark pages.
  const LIGHT = {
    page: "#ffffff", ink: "#222222", faint: "#d9d9d9", map: "#6b6b6b",
    scan: "#0072b2", particle: "#b5538c", reference: "#007a59", estimate: "#c24e00",
  };
  const DARK = {
    page: "#16181c", ink: "#e8e8e8", faint: "#3c4048", map: "#a0a0a0",
    scan: "#56b4e9", particle: "#e8a5c9", reference: "#33c99b", estimate: "#ff9a4d",
  };
  const paletteOf = (element) => (isDark(element) ? DARK : LIGHT);
  /** Keeps the colours of legends those of the canvases. */
  const colorKeys = (element) => {
    const recolor = () => {
      for (const [name, color] of Object.entries(paletteOf(element))) element.style.setProperty(`--key-${name}`, color);
    };
    redraws.add(recolor);
    recolor();
  };

  /** A canvas that fits its box at the screen's resolution, drawn by `draw(context, width, height)`. */
  const surface = (className, text, draw) => {
    const canvas = make("canvas", { className, role: "img", "aria-label": text });
    const context = canvas.getContext("2d");
    const redraw = () => {
      const { clientWidth: width, clientHeight: height } = canvas;
      if (width === 0 || height === 0) return;
      // Paper is finer than a screen.
      const scale = Math.max(window.devicePixelRatio || 1, isPrinting ? 2 : 1);
      const [wide, high] = [Math.round(width * scale), Math.round(height * scale)];
      if (canvas.width !== wide || canvas.height !== high) [canvas.width, canvas.height] = [wide, high];
      context.setTransform(scale, 0, 0, scale, 0, 0);
      context.clearRect(0, 0, width, height);
      draw(context, width, height);
    };
    new ResizeObserver(redraw).observe(canvas);
    redraws.add(redraw);
    return { canvas, redraw };
  };

  /** Metres to pixels, y up: what of the box fits into a rectangle. */
  const viewOf = ([left, bottom, right, top], x, y, width, height, margin) => {
    const scale = Math.min((width - 2 * margin) / (right - left || 1), (height - 2 * margin) / (top - bottom || 1));
    const [midX, midY] = [(left + right) / 2, (bottom + top) / 2];
    return {
      x, y, width, height, scale,
      toX: (metres) => x + width / 2 + (metres - midX) * scale,
      toY: (metres) => y + height / 2 - (metres - midY) * scale,
      toMetres: (pixels) => midX + (pixels - x - width / 2) / scale,
    };
  };
  /** The box around points of even length `[x…]`, `[y…]`. */
  const boxOf = (...pairs) => {
    const box = [Infinity, Infinity, -Infinity, -Infinity];
    for (const [xs, ys] of pairs) {
      for (let i = 0; i < xs.length; i += 1) {
        if (Number.isNaN(xs[i])) continue;
        box[0] = Math.min(box[0], xs[i]);
        box[1] = Math.min(box[1], ys[i]);
        box[2] = Math.max(box[2], xs[i]);
        box[3] = Math.max(box[3], ys[i]);
      }
    }
    return box[0] <= box[2] ? box : [-1, -1, 1, 1];
  };
  const within = (context, view, draw) => {
    context.save();
    context.beginPath();
    context.rect(view.x, view.y, view.width, view.height);
    context.clip();
    draw();
    context.restore();
  };
  const FONT = "12px system-ui, sans-serif";

  /** A bar of 1, 2 or 5 · 10ⁿ metres in the lower left corner. */
  const drawScale = (context, view, colors) => {
    const most = (0.3 * view.width) / view.scale;
    const decade = 10 ** Math.floor(Math.log10(most));
    const metres = decade * [5, 2, 1].find((times) => times * decade <= most);
    const [x, y] = [view.x + 10, view.y + view.height - 10];
    context.font = FONT;
    const text = `${metres} m`;
    context.fillStyle = colors.page;
    context.globalAlpha = 0.8;
    context.fillRect(x - 4, y - 20, Math.max(metres * view.scale, context.measureText(text).width) + 8, 26);
    context.globalAlpha = 1;
    context.strokeStyle = context.fillStyle = colors.ink;
    context.lineWidth = 1.5;
    context.beginPath();
    context.moveTo(x, y - 4);
    context.lineTo(x, y);
    context.lineTo(x + metres * view.scale, y);
    context.lineTo(x + metres * view.scale, y - 4);
    context.stroke();
    context.textAlign = "left";
    context.textBaseline = "alphabetic";
    context.fillText(text, x, y - 7);
  };

  // ── Runs ─────────────────────────────────────────────────────────────────────────────────────────────────────

  const ABSENT = -32768;
  /** Half of the width of the close view (m). */
  const CLOSE = 3.5;
  /** Shown scans per second at speed 1; on pages that shall hold still fewer. */
  const RATE = 10;
  const STILL_RATE = 2;

  /** A run with its arrays in metres, radians and seconds. */
  const unpackRun = async ({ role, run }) => {
    const planes = await Planes.of(run.data);
    const { frames, particles, beams, origin, step_m: step } = run;
    const metres = (axis, numbers) =>
      Float64Array.from(numbers, (number) => (number === ABSENT ? NaN : origin[axis] + number * step));
    const angles = (numbers) => Float64Array.from(numbers, (number) => (number / 32767) * Math.PI);
    const poses = () => ({
      x: metres(0, planes.take(Int16Array, frames)),
      y: metres(1, planes.take(Int16Array, frames)),
      theta: angles(planes.take(Int16Array, frames)),
    });
    const found = { role, ...run };
    found.time = Float64Array.from(planes.take(Uint32Array, frames), (time) => time / 1e3);
    found.scan = planes.take(Uint32Array, frames);
    found.pathEnd = planes.take(Uint32Array, frames);
    found.reference = poses();
    found.estimate = poses();
    [found.weighted, found.translation, found.heading, found.worst] = [0, 0, 0, 0].map(() =>
      planes.take(Float32Array, frames),
    );
    found.used = planes.take(Uint32Array, frames);
    const around = (center) => {
      const offsets = planes.take(Int16Array, frames * particles);
      return Float64Array.from(offsets, (offset, i) => center[Math.floor(i / particles)] + offset * step);
    };
    found.particleX = around(found.estimate.x);
    found.particleY = around(found.estimate.y);
    found.particleTheta = Float64Array.from(planes.take(Uint8Array, frames * particles), (t) => (t / 128) * Math.PI);
    found.direction = angles(planes.take(Int16Array, frames * beams));
    found.range = Float64Array.from(planes.take(Uint16Array, frames * beams), (range) => range / 100);
    const path = () => ({
      x: metres(0, planes.take(Int16Array, run.path_poses)),
      y: metres(1, planes.take(Int16Array, run.path_poses)),
    });
    found.referencePath = path();
    found.estimatePath = path();
    found.mapX = metres(0, planes.take(Int16Array, run.map_points));
    found.mapY = metres(1, planes.take(Int16Array, run.map_points));
    const { referencePath, estimatePath } = found;
    found.box = boxOf([found.mapX, found.mapY], [referencePath.x, referencePath.y], [estimatePath.x, estimatePath.y]);
    return found;
  };

  /** The last place whose time is not after `time`. */
  const placeAt = (times, time) => {
    let [low, high] = [0, times.length - 1];
    while (low < high) {
      const middle = Math.ceil((low + high) / 2);
      if (times[middle] <= time + 1e-9) low = middle;
      else high = middle - 1;
    }
    return low;
  };

  const drawMap = (context, view, run, colors, size) => {
    context.fillStyle = context.strokeStyle = colors.map;
    if (run.map_is_lines) {
      context.lineWidth = size;
      context.beginPath();
      for (let i = 0; i + 1 < run.mapX.length; i += 2) {
        context.moveTo(view.toX(run.mapX[i]), view.toY(run.mapY[i]));
        context.lineTo(view.toX(run.mapX[i + 1]), view.toY(run.mapY[i + 1]));
      }
      context.stroke();
      return;
    }
    for (let i = 0; i < run.mapX.length; i += 1) {
      context.fillRect(view.toX(run.mapX[i]) - size / 2, view.toY(run.mapY[i]) - size / 2, size, size);
    }
  };

  const drawPath = (context, view, { x, y }, end, color, width, dash) => {
    context.strokeStyle = color;
    context.lineWidth = width;
    context.setLineDash(dash);
    context.beginPath();
    let isDown = false;
    for (let i = 0; i < end; i += 1) {
      if (Number.isNaN(x[i])) {
        isDown = false;
        continue;
      }
      if (isDown) context.lineTo(view.toX(x[i]), view.toY(y[i]));
      else context.moveTo(view.toX(x[i]), view.toY(y[i]));
      isDown = true;
    }
    context.stroke();
    context.setLineDash([]);
  };

  /** An arrowhead; hollow for the reference. */
  const drawRobot = (context, view, { x, y, theta }, at, color, size, isHollow, colors) => {
    if (Number.isNaN(x[at])) return;
    context.save();
    context.translate(view.toX(x[at]), view.toY(y[at]));
    context.rotate(-theta[at]);
    context.beginPath();
    context.moveTo(1.2 * size, 0);
    context.lineTo(-0.8 * size, 0.8 * size);
    context.lineTo(-0.4 * size, 0);
    context.lineTo(-0.8 * size, -0.8 * size);
    context.closePath();
    context.lineJoin = "round";
    // A rim of the page's colour keeps it apart from what lies below.
    context.strokeStyle = colors.page;
    context.lineWidth = isHollow ? 5 : 3;
    context.stroke();
    context.strokeStyle = context.fillStyle = color;
    context.lineWidth = 2;
    if (isHollow) context.stroke();
    else context.fill();
    context.restore();
  };

  const drawScan = (context, view, run, at, colors, size, isWithBeams) => {
    const { x, y, theta } = run.estimate;
    const [fromX, fromY] = [view.toX(x[at]), view.toY(y[at])];
    const ends = [];
    for (let beam = at * run.beams; beam < (at + 1) * run.beams; beam += 1) {
      const range = run.range[beam];
      if (range === 0) continue;
      const direction = theta[at] + run.direction[beam];
      ends.push([view.toX(x[at] + range * Math.cos(direction)), view.toY(y[at] + range * Math.sin(direction))]);
    }
    context.strokeStyle = context.fillStyle = colors.scan;
    if (isWithBeams) {
      context.globalAlpha = 0.18;
      context.lineWidth = 1;
      context.beginPath();
      for (const [endX, endY] of ends) {
        context.moveTo(fromX, fromY);
        context.lineTo(endX, endY);
      }
      context.stroke();
      context.globalAlpha = 1;
    }
    for (const [endX, endY] of ends) {
      context.beginPath();
      context.arc(endX, endY, size, 0, 2 * Math.PI);
      context.fill();
    }
  };

  const drawParticles = (context, view, run, at, colors, size, tick) => {
    context.strokeStyle = context.fillStyle = colors.particle;
    context.lineWidth = 1;
    for (let i = at * run.particles; i < (at + 1) * run.particles; i += 1) {
      const [x, y] = [view.toX(run.particleX[i]), view.toY(run.particleY[i])];
      context.beginPath();
      context.arc(x, y, size, 0, 2 * Math.PI);
      context.fill();
      if (tick === 0) continue;
      context.beginPath();
      context.moveTo(x, y);
      context.lineTo(x + tick * Math.cos(run.particleTheta[i]), y - tick * Math.sin(run.particleTheta[i]));
      context.stroke();
    }
  };

  /** All of a box, and beside or below it what is around the estimate. */
  const drawRun = (context, width, height, box, run, at, colors) => {
    context.fillStyle = colors.page;
    context.fillRect(0, 0, width, height);
    const isBeside = width > 1.25 * height;
    const gap = 8;
    const side = isBeside ? Math.min(height, 0.42 * width) : Math.min(width, 0.45 * height);
    const whole = isBeside
      ? viewOf(box, 0, 0, width - side - gap, height, 12)
      : viewOf(box, 0, 0, width, height - side - gap, 12);
    const [x, y] = [run.estimate.x[at], run.estimate.y[at]];
    const around = [x - CLOSE, y - CLOSE, x + CLOSE, y + CLOSE];
    const close = isBeside
      ? viewOf(around, width - side, 0, side, height, 0)
      : viewOf(around, 0, height - side, width, side, 0);
    within(context, whole, () => {
      drawMap(context, whole, run, colors, 1.3);
      drawPath(context, whole, run.referencePath, run.pathEnd[at], colors.reference, 2.5, []);
      drawPath(context, whole, run.estimatePath, run.pathEnd[at], colors.estimate, 1.5, [5, 3]);
      drawScan(context, whole, run, at, colors, 1.2, false);
      context.strokeStyle = colors.ink;
      context.lineWidth = 1;
      const [halfX, halfY] = [close.width / close.scale / 2, close.height / close.scale / 2];
      context.strokeRect(
        whole.toX(x - halfX), whole.toY(y + halfY), 2 * halfX * whole.scale, 2 * halfY * whole.scale,
      );
      drawParticles(context, whole, run, at, colors, 1.6, 0);
      drawRobot(context, whole, run.reference, at, colors.reference, 8, true, colors);
      drawRobot(context, whole, run.estimate, at, colors.estimate, 6, false, colors);
      drawScale(context, whole, colors);
    });
    within(context, close, () => {
      drawMap(context, close, run, colors, 3);
      drawPath(context, close, run.referencePath, run.pathEnd[at], colors.reference, 2.5, []);
      drawPath(context, close, run.estimatePath, run.pathEnd[at], colors.estimate, 1.5, [5, 3]);
      drawScan(context, close, run, at, colors, 2.5, true);
      drawRobot(context, close, run.reference, at, colors.reference, 15, true, colors);
      drawRobot(context, close, run.estimate, at, colors.estimate, 10, false, colors);
      // Those that agree hide behind the estimate: here they are on top.
      context.globalAlpha = 0.75;
      drawParticles(context, close, run, at, colors, 1.8, 9);
      context.globalAlpha = 1;
      drawScale(context, close, colors);
    });
    context.strokeStyle = colors.faint;
    context.lineWidth = 1;
    for (const view of [whole, close]) context.strokeRect(view.x + 0.5, view.y + 0.5, view.width - 1, view.height - 1);
  };

  /** Weighted errors over time, logarithmic; the second run dashed. */
  const drawErrors = (context, width, height, runs, time, duration, colors) => {
    const [left, right, top, bottom] = [44, 8, 8, 22];
    const values = runs.flatMap((run) => [...run.weighted, ...run.worst].filter((value) => value > 0));
    context.fillStyle = colors.page;
    context.fillRect(0, 0, width, height);
    context.font = FONT;
    context.fillStyle = colors.ink;
    context.textBaseline = "middle";
    if (values.length === 0) {
      context.textAlign = "center";
      context.fillText("no reference, hence no error", width / 2, height / 2);
      return;
    }
    const low = Math.floor(Math.log10(values.reduce((a, b) => Math.min(a, b))));
    const high = Math.max(Math.ceil(Math.log10(values.reduce((a, b) => Math.max(a, b)))), low + 1);
    const toX = (seconds) => left + (seconds / (duration || 1)) * (width - left - right);
    const toY = (value) => {
      const share = (Math.log10(Math.max(value, 10 ** low)) - low) / (high - low);
      return height - bottom - share * (height - top - bottom);
    };
    context.strokeStyle = colors.faint;
    context.lineWidth = 1;
    context.textAlign = "right";
    const every = Math.ceil((high - low) / Math.max(1, Math.floor((height - top - bottom) / 22)));
    for (let decade = low; decade <= high; decade += every) {
      const y = toY(10 ** decade);
      context.beginPath();
      context.moveTo(left, y);
      context.lineTo(width - right, y);
      context.stroke();
      context.fillText(String(Number((10 ** decade).toPrecision(1))), left - 6, y);
    }
    context.textBaseline = "alphabetic";
    context.textAlign = "left";
    context.fillText(runs[0].is_stamped ? "0 s" : "scan 0", left, height - 6);
    context.textAlign = "right";
    context.fillText(runs[0].is_stamped ? `${digits(duration)} s` : String(duration), width - right, height - 6);
    context.textAlign = "center";
    context.fillText("weighted error d over time", left + (width - left - right) / 2, height - 6);
    const shades = [colors.estimate, colors.scan];
    runs.forEach((run, place) => {
      context.strokeStyle = context.fillStyle = shades[place];
      // From the error of a shown scan to the largest since the one before.
      context.globalAlpha = 0.45;
      context.lineWidth = 1;
      context.beginPath();
      for (let i = 0; i < run.frames; i += 1) {
        if (!(run.worst[i] > run.weighted[i])) continue;
        context.moveTo(toX(run.time[i]), toY(run.weighted[i]));
        context.lineTo(toX(run.time[i]), toY(run.worst[i]));
      }
      context.stroke();
      context.globalAlpha = 1;
      context.lineWidth = 1.7;
      context.setLineDash(place === 0 ? [] : [5, 3]);
      context.beginPath();
      let isDown = false;
      for (let i = 0; i < run.frames; i += 1) {
        if (Number.isNaN(run.weighted[i])) {
          isDown = false;
          continue;
        }
        if (isDown) context.lineTo(toX(run.time[i]), toY(run.weighted[i]));
        else context.moveTo(toX(run.time[i]), toY(run.weighted[i]));
        isDown = true;
      }
      context.stroke();
      context.setLineDash([]);
      const at = placeAt(run.time, time);
      context.beginPath();
      context.arc(toX(time), toY(run.weighted[at]), 4, 0, 2 * Math.PI);
      context.fill();
    });
    context.strokeStyle = colors.ink;
    context.lineWidth = 1;
    context.beginPath();
    context.moveTo(toX(time), top);
    context.lineTo(toX(time), height - bottom);
    context.stroke();
  };

  const errorText = (run, at) =>
    Number.isNaN(run.weighted[at])
      ? "no reference"
      : `d ${digits(run.weighted[at])}, ${digits(run.translation[at])} m, ` +
        `${digits((run.heading[at] * 180) / Math.PI)}°`;

  const LEGEND = [
    ["map", "map"], ["scan", "scan, seen from the estimate"], ["particle", "particles"],
    ["reference", "reference (hollow, solid path)"], ["estimate", "estimate (filled, dashed path)"],
  ];

  const mountWatch = async (root, group) => {
    const all = await Promise.all(group.runs.map(unpackRun));
    const runName = (run) => (run.role === "only" ? run.label : `${run.role}: ${run.label}`);
    let [time, ticks, duration, isPlaying, frame, before] = [0, [0], 0, false, 0, 0];
    const panes = [];
    const shown = () => panes.map((pane) => pane.run).filter(Boolean);
    // Side by side, both have one scale.
    const box = () => boxOf(...shown().map((run) => [[run.box[0], run.box[2]], [run.box[1], run.box[3]]]));
    root.setAttribute("role", "group");
    root.setAttribute("aria-label", `Player: ${group.title}`);
    colorKeys(root);

    const makePane = (run, isSecond) => {
      const pane = { run };
      const { canvas, redraw } = surface("watch-scene", "Map with robot, scan and particles", (context, width, height) => {
        if (pane.run) drawRun(context, width, height, box(), pane.run, placeAt(pane.run.time, time), paletteOf(root));
      });
      const choice = make("select", {}, ...(isSecond ? [option("", "none")] : []));
      choice.append(...all.map((other, place) => option(place, runName(other))));
      choice.value = run ? String(all.indexOf(run)) : "";
      choice.addEventListener("change", () => {
        pane.run = all[choice.value];
        retime();
      });
      const text = make("span");
      const key = make("span", { className: `watch-line${isSecond ? " is-second" : ""}` });
      const caption = make("figcaption", { className: "watch-numbers" }, key, text);
      pane.update = () => {
        pane.figure.classList.toggle("is-empty", !pane.run);
        redraw();
        if (!pane.run) return (text.textContent = "");
        const at = placeAt(pane.run.time, time);
        const { used, scan } = pane.run;
        const unit = used[at] === 1 ? "particle" : "particles";
        text.textContent = `scan ${scan[at].toLocaleString("en")}: ${errorText(pane.run, at)}; ` +
          `${used[at].toLocaleString("en")} ${unit}`;
      };
      pane.describe = () => {
        if (!pane.run) return "";
        const described = `${runName(pane.run)}, ${text.textContent}`;
        canvas.setAttribute("aria-label", `Map with robot, scan and particles. ${described}`);
        return described;
      };
      const field = labelled(isSecond ? "beside it" : "run", choice);
      pane.figure = make("figure", { className: "watch-pane" }, ...(all.length > 1 ? [field] : []), canvas, caption);
      panes.push(pane);
      return pane.figure;
    };

    const errors = surface("watch-errors", "Weighted error over time", (context, width, height) =>
      drawErrors(context, width, height, shown(), time, duration, paletteOf(root)),
    );
    const play = make("button", { type: "button", className: "watch-play" });
    const scrub = make("input", { type: "range", className: "watch-scrub", min: "0", step: "1", "aria-label": "Time" });
    const speed = make("select", {}, ...[["0.5", "½×"], ["1", "1×"], ["2", "2×"], ["4", "4×"]].map(([v, t]) => option(v, t)));
    speed.value = "1";
    const clock = make("span", { className: "watch-clock" });
    const status = make("p", { className: "watch-status", role: "status" });

    const seconds = (time) => `${time.toLocaleString("en", { minimumFractionDigits: 1, maximumFractionDigits: 1 })} s`;
    const timeText = () => (shown()[0]?.is_stamped ? `${seconds(time)} of ${seconds(duration)}` : `scan ${time} of ${duration}`);
    let saying = 0;
    /** Says where it stands once it stands still, and not at every step. */
    const say = () => {
      clearTimeout(saying);
      saying = setTimeout(() => {
        const described = `${timeText()}. ${panes.map((pane) => pane.describe()).filter(Boolean).join("; ")}`;
        errors.canvas.setAttribute("aria-label", `Weighted error over time. ${described}`);
        if (!isPlaying) status.textContent = described;
      }, 400);
    };
    const update = () => {
      frame = placeAt(ticks, time);
      scrub.value = String(frame);
      scrub.setAttribute("aria-valuetext", timeText());
      clock.textContent = timeText();
      root.dataset.frame = String(frame);
      panes.forEach((pane) => pane.update());
      errors.redraw();
      if (!isPlaying) say();
    };
    const seek = (place) => {
      time = ticks[Math.max(0, Math.min(ticks.length - 1, place))];
      update();
    };
    /** Other runs are shown: their times are those that can be gone to. */
    const retime = () => {
      ticks = [...new Set(shown().flatMap((run) => [...run.time]))].sort((a, b) => a - b);
      duration = ticks[ticks.length - 1];
      scrub.max = String(ticks.length - 1);
      time = ticks[placeAt(ticks, Math.min(time, duration))];
      root.classList.toggle("is-single", shown().length < 2);
      update();
    };
    const go = (isOn) => {
      isPlaying = isOn;
      play.textContent = isPlaying ? "Pause" : "Play";
      root.dataset.playing = String(isPlaying);
      if (!isPlaying) return say();
      if (frame >= ticks.length - 1) seek(0);
      before = performance.now();
      requestAnimationFrame(tick);
    };
    const tick = (now) => {
      if (!isPlaying) return;
      const rate = stillness.matches ? STILL_RATE : RATE * Number(speed.value);
      const passed = Math.min(now - before, 250) / 1e3;
      before = now;
      // A mean step of the run takes 1/rate seconds, and longer steps longer.
      const next = Math.min(time + passed * rate * (duration / Math.max(1, ticks.length - 1)), duration);
      const moved = placeAt(ticks, next) !== frame;
      time = next;
      if (moved) update();
      if (time >= duration) return go(false);
      requestAnimationFrame(tick);
    };

    play.addEventListener("click", () => go(!isPlaying));
    scrub.addEventListener("input", () => seek(Number(scrub.value)));
    root.addEventListener("keydown", (event) => {
      if (event.altKey || event.ctrlKey || event.metaKey || event.target.tagName === "SELECT") return;
      const moves = { ArrowLeft: frame - 1, ArrowRight: frame + 1, Home: 0, End: ticks.length - 1 };
      if (event.key === " " && event.target !== play) go(!isPlaying);
      else if (event.key in moves) seek(moves[event.key]);
      else return;
      event.preventDefault();
    });
    const isNarrow = root.clientWidth < 560;
    const scenes = make("div", { className: "watch-scenes" }, makePane(all[0], false));
    if (all.length > 1) scenes.append(makePane(isNarrow ? undefined : all[all.length - 1], true));
    scenes.addEventListener("click", (event) => event.target.tagName === "CANVAS" && scrub.focus({ preventScroll: true }));
    const toPointer = (event) => {
      const box = errors.canvas.getBoundingClientRect();
      const share = (event.clientX - box.left - 44) / (box.width - 52);
      seek(placeAt(ticks, share * duration));
    };
    errors.canvas.addEventListener("pointerdown", (event) => {
      errors.canvas.setPointerCapture(event.pointerId);
      toPointer(event);
    });
    errors.canvas.addEventListener("pointermove", (event) => {
      if (errors.canvas.hasPointerCapture(event.pointerId)) toPointer(event);
    });

    const legend = make("ul", { className: "watch-legend" });
    legend.append(...LEGEND.map(([name, text]) => make("li", {}, make("span", { className: `watch-key is-${name}` }), text)));
    root.replaceChildren(
      make("p", { className: "watch-rule", textContent: group.rule }),
      scenes, legend, errors.canvas,
      make("div", { className: "watch-controls" }, play, scrub, clock, labelled("speed", speed)),
      make("p", { className: "watch-keys", textContent: "Keys: space plays and pauses, ← and → step by a scan, Home and End jump." }),
      status,
    );
    // A still frame that says something: in the middle of the run.
    retime();
    seek(Math.floor((ticks.length - 1) / 2));
    go(false);
  };

  // ── Maps ─────────────────────────────────────────────────────────────────────────────────────────────────────

  // A few of viridis (van der Walt and Smith, 2015) without what vanishes on the page, and of a blue that turns orange
  // through grey, as bright at both ends.
  const LIKELIHOOD_ON_LIGHT = [[68, 1, 84], [59, 82, 139], [33, 145, 140], [94, 201, 98], [223, 200, 30]];
  const LIKELIHOOD_ON_DARK = [[240, 225, 60], [94, 201, 98], [45, 145, 150], [84, 96, 165]];
  const GAIN_ON_LIGHT = [[179, 88, 6], [230, 140, 60], [205, 205, 205], [90, 150, 205], [5, 80, 160]];
  const GAIN_ON_DARK = [[255, 160, 70], [190, 110, 50], [85, 88, 95], [70, 125, 190], [120, 190, 255]];
  const colorOf = (anchors, share) => {
    const place = Math.max(0, Math.min(1, share)) * (anchors.length - 1);
    const low = Math.min(Math.floor(place), anchors.length - 2);
    const channels = anchors[low].map((from, i) => Math.round(from + (place - low) * (anchors[low + 1][i] - from)));
    return `rgb(${channels.join(",")})`;
  };
  const tableOf = (anchors) => Array.from({ length: 256 }, (_, shade) => colorOf(anchors, shade / 255));

  const mountMaps = async (root, pair) => {
    const planes = await Planes.of(pair.data);
    const metres = (axis, count) =>
      Float64Array.from(planes.take(Int16Array, count), (number) => pair.origin[axis] + number * pair.step_m);
    const points = { x: metres(0, pair.points), y: metres(1, pair.points) };
    const shades = pair.maps.map(() => planes.take(Uint8Array, pair.points));
    const maps = pair.maps.map((map) => ({ x: metres(0, map.points), y: metres(1, map.points) }));
    const box = boxOf([points.x, points.y]);
    const nats = (pair.high - pair.low) / 255;
    const gains = Float64Array.from(shades[0], (shade, i) => (shades[1][i] - shade) * nats);
    const sorted = [...gains].map(Math.abs).sort((a, b) => a - b);
    const mostGain = sorted[Math.floor(0.98 * (sorted.length - 1))] || 1;
    // What is explained worst is drawn last, on top, and larger.
    const orders = [...shades, gains.map((gain) => -Math.abs(gain))].map((values) =>
      [...values.keys()].sort((a, b) => values[b] - values[a]),
    );
    root.setAttribute("role", "group");
    root.setAttribute("aria-label", `Comparison: ${pair.title}`);
    colorKeys(root);
    let share = 0.5;

    const mode = make("select", {}, option("both", "likelihood under each map"), option("gain", "gain of the second over the first"));
    const withMap = make("input", { type: "checkbox" });
    const slider = make("input", {
      type: "range", className: "compare-slider", min: "0", max: "100", step: "1", value: "50",
      "aria-label": "How much of the first map is shown, from the left",
    });
    const isGain = () => mode.value === "gain";
    const anchors = () => {
      if (isGain()) return isDark(root) ? GAIN_ON_DARK : GAIN_ON_LIGHT;
      // What is unlikely stands out: dark on light pages, light on dark ones.
      return isDark(root) ? LIKELIHOOD_ON_DARK : LIKELIHOOD_ON_LIGHT;
    };
    const drawPoints = (context, view, place) => {
      const table = tableOf(anchors());
      for (const i of orders[place]) {
        const shade = isGain() ? Math.round(127.5 * (1 + Math.max(-1, Math.min(1, gains[i] / mostGain)))) : shades[place][i];
        const badness = isGain() ? Math.abs(shade - 127.5) / 127.5 : 1 - shade / 255;
        const size = 1.6 + 1.8 * badness * badness;
        context.fillStyle = table[shade];
        context.fillRect(view.toX(points.x[i]) - size / 2, view.toY(points.y[i]) - size / 2, size, size);
      }
    };
    const drawMarks = (context, view, map, colors) => {
      context.strokeStyle = colors.ink;
      context.lineWidth = 0.8;
      context.beginPath();
      for (let i = 0; i < map.x.length; i += 1) {
        const [x, y] = [view.toX(map.x[i]), view.toY(map.y[i])];
        context.moveTo(x + 2, y);
        context.arc(x, y, 2, 0, 2 * Math.PI);
      }
      context.stroke();
    };
    const label = (context, text, x, y, align, colors) => {
      context.font = `600 ${FONT}`;
      context.textAlign = align;
      context.textBaseline = "top";
      const { width } = context.measureText(text);
      context.fillStyle = colors.page;
      context.globalAlpha = 0.85;
      context.fillRect(align === "left" ? x - 4 : x - width - 4, y - 3, width + 8, 19);
      context.globalAlpha = 1;
      context.fillStyle = colors.ink;
      context.fillText(text, x, y);
    };
    const scene = surface("compare-scene", "Data points coloured by their log-likelihood", (context, width, height) => {
      const colors = paletteOf(root);
      context.fillStyle = colors.page;
      context.fillRect(0, 0, width, height);
      const view = viewOf(box, 0, 0, width, height, 34);
      const [first, second] = pair.maps.map((map) => map.label);
      if (isGain()) {
        drawPoints(context, view, 2);
        if (withMap.checked) drawMarks(context, view, maps[1], colors);
        label(context, `${second} over ${first}`, 10, 8, "left", colors);
      } else {
        const at = share * width;
        [[0, at], [at, width - at]].forEach(([x, wide], place) => {
          within(context, { x, y: 0, width: wide, height }, () => {
            drawPoints(context, view, place);
            if (withMap.checked) drawMarks(context, view, maps[place], colors);
            if (place === 0) label(context, `◀ ${first}`, 10, 8, "left", colors);
            else label(context, `${second} ▶`, width - 10, 8, "right", colors);
          });
        });
        context.fillStyle = colors.ink;
        context.fillRect(at - 1, 0, 2, height);
        context.beginPath();
        context.arc(at, height / 2, 7, 0, 2 * Math.PI);
        context.fill();
      }
      drawScale(context, view, colors);
    });
    const legend = surface("compare-legend", "Colours", (context, width, height) => {
      const colors = paletteOf(root);
      const [low, high] = isGain() ? [-mostGain, mostGain] : [pair.low, pair.high];
      const table = tableOf(anchors());
      const [left, right, bar] = [36, 36, 14];
      for (let x = left; x < width - right; x += 1) {
        context.fillStyle = table[Math.round((255 * (x - left)) / (width - left - right - 1))];
        context.fillRect(x, 0, 1, bar);
      }
      context.font = FONT;
      context.fillStyle = colors.ink;
      context.textBaseline = "top";
      context.textAlign = "center";
      const steps = width < 420 ? 2 : 4;
      for (let step = 0; step <= steps; step += 1) {
        const x = left + (step / steps) * (width - left - right);
        const value = low + (step / steps) * (high - low);
        const sign = step === 0 ? "≤ " : isGain() && step === steps ? "≥ " : "";
        context.fillRect(x - 0.5, bar, 1, 4);
        context.fillText(sign + value.toFixed(1).replace("-", "−"), x, bar + 6);
      }
      context.fillText(isGain() ? "nats gained per data point" : "log-likelihood of a data point [nats]", width / 2, height - 15);
    });
    const describe = () => {
      const [first, second] = pair.maps;
      const described = (map) => `${map.label}: ${digits(map.log_likelihood)} nats per point`;
      scene.canvas.setAttribute("aria-label", `Data points coloured by their log-likelihood. ${described(first)}; ${described(second)}.`);
      legend.canvas.setAttribute(
        "aria-label",
        isGain()
          ? `Colours from ${digits(-mostGain)} to ${digits(mostGain)} nats gained`
          : `Colours from ${digits(pair.low)} to ${digits(pair.high)} nats`,
      );
      slider.setAttribute("aria-valuetext", `${slider.value} % ${first.label}, the rest ${second.label}`);
    };
    const update = () => {
      share = Number(slider.value) / 100;
      slider.disabled = isGain();
      describe();
      scene.redraw();
      legend.redraw();
    };
    for (const control of [mode, withMap, slider]) control.addEventListener("input", update);
    const toPointer = (event) => {
      if (isGain()) return;
      const place = scene.canvas.getBoundingClientRect();
      slider.value = String(Math.round((100 * (event.clientX - place.left)) / place.width));
      update();
    };
    scene.canvas.addEventListener("pointerdown", (event) => {
      scene.canvas.setPointerCapture(event.pointerId);
      toPointer(event);
    });
    scene.canvas.addEventListener("pointermove", (event) => {
      if (scene.canvas.hasPointerCapture(event.pointerId)) toPointer(event);
    });
    const counted = (count, of) => (count === of ? `all ${of.toLocaleString("en")}` : `${count.toLocaleString("en")} of ${of.toLocaleString("en")}`);
    const note = `${counted(pair.points, pair.all_points)} data points, σ ${pair.sigma_m} m. ` +
      pair.maps.map((map) => `${map.label}: ${map.size.toLocaleString("en")} points, ${map.log_likelihood.toFixed(3).replace("-", "−")} nats per point`).join("; ") + ".";
    root.replaceChildren(
      make("p", { className: "watch-rule", textContent: pair.rule }),
      scene.canvas, slider, legend.canvas,
      make("div", { className: "watch-controls" }, labelled("colour", mode), labelled("points of the maps", withMap)),
      make("p", { className: "watch-numbers", textContent: note }),
    );
    update();
  };

  // ── Mounting ─────────────────────────────────────────────────────────────────────────────────────────────────

  const mount = async (slot) => {
    if (slot.dataset.ready !== undefined) return;
    slot.dataset.ready = "false";
    const isWatch = slot.classList.contains("watch");
    try {
      const text = document.getElementById(isWatch ? slot.dataset.run : slot.dataset.maps).textContent;
      await (isWatch ? mountWatch : mountMaps)(slot, JSON.parse(text));
    } catch (error) {
      // Of browsers from before 2023, which cannot unpack.
      slot.textContent = `This cannot be shown here: ${error.message}`;
    }
    slot.dataset.ready = "true";
  };
  const slots = [...document.querySelectorAll(".watch[data-run], .compare-maps[data-maps]")];
  const seen = new IntersectionObserver(
    (entries) => entries.filter((entry) => entry.isIntersecting).forEach((entry) => mount(entry.target)),
    { rootMargin: "600px" },
  );
  slots.forEach((slot) => seen.observe(slot));
  // The others when there is nothing else to do: a print shows all of them.
  const whenIdle = window.requestIdleCallback || ((later) => setTimeout(later, 200));
  const mountNext = () => {
    const slot = slots.find((other) => other.dataset.ready === undefined);
    if (slot) mount(slot).then(() => whenIdle(mountNext));
  };
  addEventListener("load", () => whenIdle(mountNext));
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", redrawAll);
  new MutationObserver(redrawAll).observe(document.documentElement, { attributes: true });
  addEventListener("beforeprint", () => {
    isPrinting = true;
    redrawAll();
  });
  addEventListener("afterprint", () => {
    isPrinting = false;
    redrawAll();
  });
})();
