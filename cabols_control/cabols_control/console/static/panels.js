// Everything on the live side that is text: limbs, mode, health, log, who is in command.
const TEXT_EVERY = 4;
const LOG_KEPT = 200;
const NEAR = 0.9;
const LEVEL_WORDS = { info: ["wait", "info"], notice: ["ok", "done"], warning: ["warn", "warning"], fault: ["fault", "FAULT"] };

const byId = (id) => document.getElementById(id);

function put(element, text) {
  if (element && element.textContent !== text) element.textContent = text;
}

function mark(element, name, value) {
  if (element && element.dataset[name] !== value) element.dataset[name] = value;
}

function shown(value, digits) {
  return value === null || value === undefined ? "\u2013" : value.toFixed(digits);
}

function row(cells) {
  const tr = document.createElement("tr");
  for (const cell of cells) {
    const td = document.createElement("td");
    if (cell.className) td.className = cell.className;
    if (cell.node) td.append(cell.node);
    else td.textContent = cell.text;
    if (cell.why) {
      const why = document.createElement("div");
      why.className = "why";
      why.textContent = cell.why;
      td.append(why);
    }
    tr.append(td);
  }
  return tr;
}

function status(level, word) {
  const span = document.createElement("span");
  span.className = "status";
  span.dataset.level = level;
  span.textContent = word;
  return span;
}

export class Panels {
  constructor(settings) {
    this.settings = settings;
    this.turn = 0;
    this.newestEvent = 0;
    this.limbs = Array.from({ length: settings.scene.base_points.length }, (_, i) => ({
      tension: byId(`t-${i}`), setpoint: byId(`a-${i}`), current: byId(`c-${i}`),
      tensionBar: byId(`tb-${i}`), setpointMark: byId(`tm-${i}`), currentBar: byId(`cb-${i}`),
      closed: byId(`s-${i}`), zeroed: byId(`z-${i}`), badge: byId(`h-${i}`),
    }));
  }

  frame(frame) {
    const { tension_max: most, current_limit: amperes } = this.settings.scene;
    const words = this.turn++ % TEXT_EVERY === 0;
    this.limbs.forEach((limb, i) => {
      const tension = frame.T ? frame.T[i] : null, setpoint = frame.A ? frame.A[i] : null;
      const current = frame.C ? frame.C[i] : null;
      limb.tensionBar.style.transform = `scaleX(${Math.min(Math.max((tension ?? 0) / most, 0), 1)})`;
      limb.setpointMark.style.left = `${Math.min(Math.max((setpoint ?? 0) / most, 0), 1) * 100}%`;
      limb.currentBar.style.transform = `scaleX(${Math.min(Math.max((current ?? 0) / amperes, -1), 1) / 2})`;
      if (!words) return;
      const high = tension > NEAR * most || Math.abs(current ?? 0) > NEAR * amperes;
      put(limb.tension, `${shown(tension, 1)} N`);
      put(limb.setpoint, shown(setpoint, 1));
      put(limb.current, `${shown(current, 2)} A`);
      put(limb.closed, frame.S & (1 << i) ? "\u25cf closed" : "\u25cb open");
      mark(limb.closed, "on", frame.S & (1 << i) ? "yes" : "no");
      put(limb.zeroed, frame.Z & (1 << i) ? "zero set" : "no zero");
      mark(limb.zeroed, "on", frame.Z & (1 << i) ? "yes" : "no");
      mark(limb.badge, "on", high ? "yes" : "no");
      mark(limb.tensionBar.parentElement, "high", tension > NEAR * most ? "yes" : "no");
      mark(limb.currentBar.parentElement, "high", Math.abs(current ?? 0) > NEAR * amperes ? "yes" : "no");
    });
    if (words) {
      put(byId("force-frame"), frame.f ? `axes of ${frame.f}` : "base axes");
      put(byId("torque-frame"), frame.f ? `about the origin of ${frame.f}` : "about the platform's origin");
    }
    if (words) put(byId("feasible"), frame.F === false ? "wrench beyond the cables: nearest feasible one is applied" : "");
  }

  state(state, settings) {
    if (state.mode) {
      const chip = byId("mode-chip");
      const sign = { FAULT: "\u26a0", STOPPED: "\u25a0" }[state.mode.name] ?? "\u25b6";
      mark(chip, "mode", state.mode.name);
      put(chip, `${sign} ${state.mode.text}`);
      put(byId("mode-reason"), state.mode.reason);
    }
    put(byId("wrench-error"), state.error ?? "");
    if (state.loops) this.loops(state.loops);
    if (state.devices) this.devices(state.devices);
    if (state.operator) this.operator(state.operator, settings);
    put(byId("recording-text"), state.recording ? `\u25cf recording ${state.recording.split("/").pop()}` : "not recording");
  }

  loops(rows) {
    byId("loops").replaceChildren(...rows.map((r) => row([
      { text: r.node.replaceAll("_", "_\u200b"), why: r.reason, className: "name" },
      { node: status(r.level, r.word) },
      { text: shown(r.rate, 0), className: "n" },
      { text: shown(r.late_percent, 2), className: "n" },
      { text: r.trip_us ? `${shown(r.trip_us / 1000, 2)}` : "\u2013", className: "n" },
    ])));
  }

  devices(rows) {
    const words = { ok: "ok", wait: "waiting", warn: "check", fault: "FAULT", off: "absent" };
    byId("devices").replaceChildren(...rows.map((r) => row([
      { text: r.device, why: r.text },
      { node: status(r.level, words[r.level]) },
    ])));
  }

  operator(operator, settings) {
    const mine = operator.mark && operator.mark === settings.mark;
    let text = "Nobody is in command";
    if (mine) text = "You are in command";
    else if (operator.mark) text = `${operator.name} is in command${operator.attended ? "" : ", but does not answer"}`;
    const others = operator.pages - 1;
    put(byId("operator-text"), others > 0 ? `${text} \u00b7 ${others} other page${others > 1 ? "s" : ""}` : text);
    document.body.dataset.command = mine ? "yes" : "no";
  }

  events(events) {
    const log = byId("log");
    for (const [number, seconds, level, source, text] of events) {
      if (number <= this.newestEvent) continue;
      this.newestEvent = number;
      const line = document.createElement("div");
      const time = document.createElement("time");
      time.textContent = new Date(seconds * 1000).toTimeString().slice(0, 8);
      const [sign, word] = LEVEL_WORDS[level] ?? ["wait", level];
      const who = document.createElement("span");
      who.className = "who";
      who.textContent = source;
      const what = document.createElement("span");
      what.className = "what";
      what.textContent = text;
      line.append(time, status(sign, word), who, what);
      log.prepend(line);
    }
    while (log.childElementCount > LOG_KEPT) log.lastElementChild.remove();
  }

  connection(lost) {
    const link = byId("link");
    mark(link, "lost", lost ? "yes" : "no");
    put(link, lost ? "\u2715 Connection lost: values are old" : "\u2713 Connected");
  }
}
