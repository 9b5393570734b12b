// The rig in three dimensions: one scene, told of one frame at a time.
import { THREE, OrbitControls } from "nicegui-scene";

const COLOURS = [[0.30, 0.47, 0.78], [0.21, 0.69, 0.67], [0.85, 0.78, 0.29], [0.95, 0.50, 0.23], [0.90, 0.22, 0.17]];
const SLACK = 0x93a1af;
const UP = new THREE.Vector3(0, 1, 0);   // a cylinder's axis before it is turned
const SLOW_MS = 25;

function colourOf(share) {
  const at = Math.min(Math.max(share, 0), 1) * (COLOURS.length - 1), low = Math.min(Math.floor(at), COLOURS.length - 2);
  const part = at - low;
  return COLOURS[low].map((value, i) => value + part * (COLOURS[low + 1][i] - value));
}

export class RigView {
  constructor(host, scene) {
    this.host = host;
    this.plan = scene;
    this.renderer = new THREE.WebGLRenderer({ antialias: true, powerPreference: "low-power" });
    this.renderer.setPixelRatio(Math.min(window.devicePixelRatio || 1, 2));
    host.prepend(this.renderer.domElement);
    this.renderer.domElement.setAttribute("role", "img");
    this.renderer.domElement.setAttribute("aria-label", "Rig in 3-D: frame, cables, platform, robot, reflectors");
    this.scene = new THREE.Scene();
    this.scene.background = new THREE.Color(0x0b1015);
    this.camera = new THREE.PerspectiveCamera(38, 1, 0.05, 50);
    this.camera.up.set(0, 0, 1);
    const [x, y, z] = scene.reference_position;
    this.camera.position.set(x + 3.35, y + 2.05, z + 1.2);
    this.controls = new OrbitControls(this.camera, this.renderer.domElement);
    this.controls.target.set(x, y - 0.3, z - 0.02);
    this.controls.enableDamping = false;
    this.controls.addEventListener("change", () => this.request());
    this.scene.add(new THREE.HemisphereLight(0xdfe9f2, 0x20262c, 1.6));
    const sun = new THREE.DirectionalLight(0xffffff, 1.8);
    sun.position.set(4, 2, 6);
    this.scene.add(sun);
    this.grey = new THREE.MeshStandardMaterial({ color: 0x8796a5, roughness: 0.7 });
    this.orange = new THREE.MeshStandardMaterial({ color: 0xd97b2b, roughness: 0.6 });
    this.drawFrame();
    this.drawPlatform();
    this.drawRobot();
    this.drawTracker();
    this.cables = scene.base_points.map(() => this.cylinder(new THREE.MeshStandardMaterial({ color: SLACK, roughness: 0.5 })));
    this.pose = new THREE.Matrix4().setPosition(x, y, z);
    this.pending = false;
    this.cost = 0;
    this.due = 0;
    new ResizeObserver(() => this.resize()).observe(host);
    this.resize();
  }

  cylinder(material) {
    const mesh = new THREE.Mesh(new THREE.CylinderGeometry(1, 1, 1, 10), material);
    this.scene.add(mesh);
    return mesh;
  }

  span(mesh, a, b, radius) {
    const along = b.clone().sub(a), length = Math.max(along.length(), 1e-6);
    mesh.position.copy(a).addScaledVector(along, 0.5);
    mesh.scale.set(radius, length, radius);
    mesh.quaternion.setFromUnitVectors(UP, along.divideScalar(length));
  }

  drawFrame() {
    const points = this.plan.base_points.map((p) => new THREE.Vector3(...p));
    const low = points[0].clone(), high = points[0].clone();
    for (const p of points) { low.min(p); high.max(p); }
    const corner = (i) => new THREE.Vector3(i & 1 ? high.x : low.x, i & 2 ? high.y : low.y, i & 4 ? high.z : low.z);
    for (let i = 0; i < 8; i++)
      for (const bit of [1, 2, 4])
        if (!(i & bit)) this.span(this.cylinder(this.grey), corner(i), corner(i | bit), 0.016);
    const pulley = new THREE.SphereGeometry(0.032, 12, 8);
    for (const p of points) {
      const mesh = new THREE.Mesh(pulley, this.grey);
      mesh.position.copy(p);
      this.scene.add(mesh);
    }
    const grid = new THREE.GridHelper(4, 16, 0x33404c, 0x1c242c);
    grid.rotation.x = Math.PI / 2;
    grid.position.set(this.plan.reference_position[0], this.plan.reference_position[1] - 0.2, low.z - 0.02);
    this.scene.add(grid);
  }

  drawPlatform() {
    this.platform = new THREE.Group();
    const heights = this.plan.platform_points.map((p) => p[2]);
    const radius = Math.max(...this.plan.platform_points.map((p) => Math.hypot(p[0], p[1])));
    const steel = new THREE.MeshStandardMaterial({ color: 0xc9d3dc, roughness: 0.4, metalness: 0.3 });
    for (const z of [Math.min(...heights), Math.max(...heights)]) {
      const plate = new THREE.Mesh(new THREE.CylinderGeometry(radius, radius, 0.02, 28), steel);
      plate.rotation.x = Math.PI / 2;
      plate.position.z = z;
      this.platform.add(plate);
    }
    const post = new THREE.Mesh(new THREE.CylinderGeometry(0.04, 0.04, Math.max(...heights) - Math.min(...heights), 16), steel);
    post.rotation.x = Math.PI / 2;
    this.platform.add(post);
    const glass = new THREE.MeshStandardMaterial({ color: 0x7dd3fc, emissive: 0x1d6f93, roughness: 0.2 });
    for (const p of this.plan.reflectors) {
      const ball = new THREE.Mesh(new THREE.SphereGeometry(0.022, 14, 10), glass);
      ball.position.set(...p);
      this.platform.add(ball);
    }
    this.platform.add(new THREE.AxesHelper(0.2));
    this.scene.add(this.platform);
  }

  drawRobot() {
    const robot = this.plan.robot;
    this.links = robot ? robot.offsets.map(() => this.cylinder(this.orange)) : [];
    this.knees = this.links.map(() => {
      const ball = new THREE.Mesh(new THREE.SphereGeometry(0.1, 16, 12), this.orange);
      this.scene.add(ball);
      return ball;
    });
    for (const mesh of [...this.links, ...this.knees]) mesh.visible = false;
  }

  drawTracker() {
    if (!this.plan.tracker) return;
    const body = new THREE.Mesh(new THREE.BoxGeometry(0.16, 0.16, 0.26), this.grey);
    body.position.set(...this.plan.tracker);
    this.scene.add(body);
  }

  // Joints turn about an axis of the frame before them, after an offset in that frame.
  moveRobot(joints) {
    const { base, offsets, axes, flange } = this.plan.robot;
    const at = new THREE.Matrix4().setPosition(...base), points = [];
    offsets.forEach((offset, i) => {
      at.multiply(new THREE.Matrix4().makeTranslation(...offset));
      points.push(new THREE.Vector3().setFromMatrixPosition(at));
      const axis = new THREE.Vector3(axes[i] === 0 ? 1 : 0, axes[i] === 1 ? 1 : 0, axes[i] === 2 ? 1 : 0);
      at.multiply(new THREE.Matrix4().makeRotationAxis(axis, joints[i]));
    });
    points.push(new THREE.Vector3(...flange).applyMatrix4(at));
    let before = new THREE.Vector3(...base);
    points.slice(0, -1).forEach((point, i) => {
      this.span(this.links[i], before, i === points.length - 2 ? points[i + 1] : point, 0.075 - 0.007 * i);
      this.links[i].visible = true;
      this.knees[i].position.copy(point);
      this.knees[i].scale.setScalar(1 - 0.09 * i);
      this.knees[i].visible = true;
      before = point;
    });
  }

  frame(frame) {
    if (frame.P) {
      const [x, y, z, qx, qy, qz, qw] = frame.P;
      this.pose.compose(new THREE.Vector3(x, y, z), new THREE.Quaternion(qx, qy, qz, qw), new THREE.Vector3(1, 1, 1));
    }
    this.platform.matrixAutoUpdate = false;
    this.platform.matrix.copy(this.pose);
    this.plan.platform_points.forEach((p, i) => {
      const end = new THREE.Vector3(...p).applyMatrix4(this.pose), tension = frame.T ? frame.T[i] : null;
      const share = (tension ?? 0) / this.plan.tension_max, slack = !(tension >= this.plan.tension_min);
      this.span(this.cables[i], new THREE.Vector3(...this.plan.base_points[i]), end, slack ? 0.004 : 0.005 + 0.006 * Math.min(share, 1));
      if (slack) this.cables[i].material.color.setHex(SLACK);
      else this.cables[i].material.color.setRGB(...colourOf(share));
    });
    if (frame.J && this.plan.robot) this.moveRobot(frame.J);
    if (performance.now() >= this.due) this.request();
  }

  request() {
    if (this.pending) return;
    this.pending = true;
    requestAnimationFrame(() => {
      this.pending = false;
      const began = performance.now();
      this.renderer.render(this.scene, this.camera);
      this.cost = 0.8 * this.cost + 0.2 * (performance.now() - began);
      // A browser without a graphics card draws less often, so that it stays quick to the hand.
      this.due = performance.now() + (this.cost > SLOW_MS ? 8 * this.cost : 40);
    });
  }

  resize() {
    const { clientWidth: width, clientHeight: height } = this.host;
    if (!width || !height) return;
    this.renderer.setSize(width, height, false);
    this.camera.aspect = width / height;
    this.camera.updateProjectionMatrix();
    this.request();
  }
}
