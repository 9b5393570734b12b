// The page's wire to the console: frames, state and events come in, acknowledgements go out.
import { Chart } from "./charts.js";
import { Panels } from "./panels.js";

const ACK_MS = 400;
const LOST_MS = 1500;
const RETRY_MS = 800;

const settings = JSON.parse(document.getElementById("console-settings").textContent);

async function whenThere(id) {
  for (;;) {
    const found = document.getElementById(id);
    if (found) return found;
    await new Promise((resolve) => setTimeout(resolve, 30));
  }
}

function alarm(text) {
  const box = document.getElementById("alarm");
  box.textContent = text;
  box.dataset.on = text ? "yes" : "no";
}

// The emergency stop does not go through the page's other machinery: one plain request.
async function emergencyStop() {
  alarm("Emergency stop is being sent ...");
  const control = new AbortController();
  const timer = setTimeout(() => control.abort(), 4000);
  try {
    const reply = await fetch("/api/emergency_stop", { method: "POST", signal: control.signal });
    const said = await reply.json();
    alarm(said.success ? "" : `EMERGENCY STOP WAS NOT TAKEN: ${said.message}. Use the button on the rig.`);
  } catch (error) {
    alarm("EMERGENCY STOP DID NOT REACH THE RIG. Use the button on the rig.");
  } finally {
    clearTimeout(timer);
  }
}

class Wire {
  constructor(panels, charts) {
    this.panels = panels;
    this.charts = charts;
    this.view = null;
    this.heard = 0;
    this.acked = 0;
    this.newest = 0;
    this.connect();
    setInterval(() => this.look(), 500);
  }

  connect() {
    const scheme = location.protocol === "https:" ? "wss" : "ws";
    this.socket = new WebSocket(`${scheme}://${location.host}/live?page=${settings.page}`);
    this.socket.onmessage = (event) => this.hear(JSON.parse(event.data));
    this.socket.onclose = (event) => {
      // 4404: the server does not know this page any more, e.g. after its restart.
      if (event.code === 4404) setTimeout(() => location.reload(), RETRY_MS);
      else setTimeout(() => this.connect(), RETRY_MS);
    };
  }

  hear(message) {
    const now = performance.now();
    this.heard = now;
    if (message.k === "f") this.frame(message);
    else if (message.k === "s") this.panels.state(message, settings);
    else if (message.k === "l") this.panels.events(message.events);
    if (message.k === "p" || now - this.acked > ACK_MS) {
      this.acked = now;
      this.socket.send(JSON.stringify({ a: this.newest }));
    }
  }

  frame(frame) {
    this.newest = frame.n;
    this.panels.frame(frame);
    for (const chart of this.charts) chart.add(frame);
    if (this.view) this.view.frame(frame);
    window.cabolsFrames = (window.cabolsFrames || 0) + 1;
  }

  look() {
    const lost = performance.now() - this.heard > LOST_MS;
    this.panels.connection(lost);
  }
}

await whenThere("log");
const stop = await whenThere("estop");
stop.addEventListener("click", emergencyStop);
const charts = [
  new Chart(document.getElementById("chart-force"), { from: 0, unit: "N", floor: 10 }),
  new Chart(document.getElementById("chart-torque"), { from: 3, unit: "N m", floor: 1 }),
];
const wire = new Wire(new Panels(settings), charts);
window.cabolsReady = true;

try {
  const { RigView } = await import("./rig_view.js");
  wire.view = new RigView(document.getElementById("view3d"), settings.scene);
} catch (error) {
  document.getElementById("view3d-note").textContent = `No 3-D view: ${error.message}`;
}
