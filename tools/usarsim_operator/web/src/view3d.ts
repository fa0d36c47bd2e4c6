// The 3D view: the true world for instructor and viewer, what robots reported for operators; orbit, follow and
// first person. Drawn on demand. Without WebGL it shows the gateway's spectator picture.

import * as THREE from "three";
import { OrbitControls } from "three/examples/jsm/controls/OrbitControls.js";
import { button, choice, colour, h, mark, panel } from "./dom";
import { graphics } from "./gl";
import { FramePace } from "./pace";
import { type Message, SPECTATOR } from "./protocol";
import { Labels, matrixOf, Reports } from "./reports";
import { type SceneData, type SceneFile, World } from "./scene";
import { isStale, LOOK_MS } from "./staleness";
import { pageTime, type Store } from "./store";
import { emptyNote, newsText, waitText } from "./waiting";

type Mode = "orbit" | "follow" | "first";
type Poses = Extract<Message, { kind: "poses" }>;

/** s without a change after which the picture becomes sharp. */
const STILL_S = 0.35;
/** s between two pictures of the scans' points. */
const CLOUD_S = 1;

export class View3D {
  readonly element: HTMLElement;
  readonly world: World;
  private readonly reports: Reports;
  private readonly labels = new Labels();
  private readonly canvas = h("canvas", { role: "img", "aria-label": "3D view", tabindex: "0" });
  private readonly note: HTMLElement;
  // Where the processors draw, input and pictures need them, too.
  private readonly pace = new FramePace(graphics().software ? 1 / 12 : 1 / 30);
  private readonly scene = new THREE.Scene();
  private readonly camera = new THREE.PerspectiveCamera(55, 1, 0.05, 300);
  private readonly indoor = new THREE.Group();
  private readonly dots = new THREE.Points(
    new THREE.BufferGeometry(),
    new THREE.PointsMaterial({ size: 0.06, vertexColors: true }),
  );
  private renderer: THREE.WebGLRenderer | null = null;
  private controls: OrbitControls | null = null;
  private mode: Mode = "orbit";
  private dirty = false;
  private calm = 0;
  private clouded = 0;
  private ratio = 0;
  private asked = -1;
  private placed = false;
  private lost = false;
  private box: SceneData | null = null;
  private heard = Number.NEGATIVE_INFINITY;
  private readonly followed = new THREE.Vector3();

  constructor(
    private readonly store: Store,
    private readonly token: string,
  ) {
    const modes = choice(
      "eye",
      { orbit: "Orbit", follow: "Follow", first: "First person" },
      "orbit",
      (mode) => this.enter(mode),
    );
    const home = button(
      "Home",
      "view-home",
      () => {
        modes.set("orbit");
        this.enter("orbit");
        if (!this.lookAtRobot() && this.box) this.overview(this.box);
        this.draw();
      },
      "orbit: the chosen robot from behind and above",
    );
    this.note = emptyNote(store, (now) => this.missing(now));
    this.element = panel(
      "view3d",
      "3D",
      [home, modes],
      h("div", { class: "stage" }, this.canvas, this.note),
    );
    this.world = new World(() => this.draw());
    this.reports = new Reports(store);
    this.camera.up.set(0, 0, 1);
    this.camera.position.set(-8, -8, 7);
    this.start();
    store.on("poses", (frame) => this.poses(frame as Poses));
    store.on("state", () => this.reported());
    store.on("welcome", () => this.begin());
    for (const topic of ["scan", "points", "select"] as const) store.on(topic, () => this.cloud());
    let before = "";
    store.on("select", () => {
      if (this.mode === "follow") this.lookAtRobot();
      else if (this.mode === "orbit" && before !== "") this.centre();
      before = store.selected;
    });
    store.on("theme", () => this.draw());
    setInterval(() => mark(this.element, "data-stale", this.old), LOOK_MS);
  }

  /** Whether what it shows is older than 1 s while the world goes on. */
  private get old(): boolean {
    const { store } = this;
    if (this.element.dataset.source === "reports" || store.ages.still) return store.frozen;
    return isStale(Math.max(store.ages.silence(pageTime()), pageTime() - this.heard));
  }

  /** Looks in another way; orbit begins at the chosen robot, and outside of it. */
  private enter(mode: Mode): void {
    const inside = this.mode === "first";
    this.mode = mode;
    this.placed ||= mode === "first";
    if (this.controls) this.controls.enabled = mode !== "first";
    if (mode === "follow" || (mode === "orbit" && inside)) this.lookAtRobot();
    else if (mode === "orbit") this.centre();
    this.follow();
    this.draw();
  }

  private get truth(): boolean {
    return this.element.dataset.source === "scene";
  }

  /** Why there is nothing to be seen. */
  private missing(now: number): string {
    const { store } = this;
    if (!graphics().webgl || this.lost) {
      const flat = store.slot(SPECTATOR).picture;
      return flat
        ? ""
        : newsText(store, now) || "no WebGL here: a picture by the server, if it has one";
    }
    if (!this.truth) {
      const known = store.robots.some((robot) => robot.pose) || store.slot(SPECTATOR).map;
      return known ? "" : waitText(store, "report of a place", now);
    }
    return this.placed ? "" : waitText(store, "view of the world", now);
  }

  private start(): void {
    if (!graphics().webgl) {
      this.withoutWebGL();
      return;
    }
    try {
      this.renderer = new THREE.WebGLRenderer({
        canvas: this.canvas,
        antialias: !graphics().software, // twice the cost of a frame there
        powerPreference: "low-power",
      });
    } catch {
      this.withoutWebGL();
      return;
    }
    mark(this.element, "data-webgl", true);
    mark(this.element, "data-quality", this.pace.quality);
    const sun = new THREE.DirectionalLight(0xffffff, 1.6);
    sun.position.set(-4, 6, 12);
    this.indoor.add(new THREE.HemisphereLight(0xffffff, 0x777788, 2), sun, this.reports.group);
    this.dots.frustumCulled = false;
    this.scene.add(this.indoor, this.world.group, this.dots, this.labels.group);
    this.controls = new OrbitControls(this.camera, this.canvas);
    this.controls.addEventListener("change", () => this.draw());
    this.controls.maxPolarAngle = 1.55;
    this.controls.target.set(0, 0, 0.3);
    this.controls.update();
    new ResizeObserver(() => {
      this.ratio = 0;
      this.draw();
    }).observe(this.canvas);
    this.canvas.addEventListener("webglcontextlost", (event) => {
      event.preventDefault();
      this.withoutWebGL();
    });
  }

  private withoutWebGL(): void {
    this.renderer = null;
    this.lost = true;
    mark(this.element, "data-webgl", false);
    const flat = h("canvas", {
      role: "img",
      "aria-label": "the world, drawn by the server",
      "data-spectator": true,
    });
    this.canvas.replaceWith(flat);
    this.store.on("picture", (index) => {
      const image = index === SPECTATOR && this.store.slot(SPECTATOR).picture?.image;
      if (!image) return;
      flat.width = image.width;
      flat.height = image.height;
      flat.getContext("2d")?.drawImage(image, 0, 0);
    });
  }

  private begin(): void {
    const scene = this.store.welcome?.features.scene && this.store.welcome.role !== "operator";
    mark(this.element, "data-source", scene ? "scene" : "reports");
    this.indoor.visible = !scene;
    this.world.group.visible = !!scene;
    this.asked = -1;
  }

  private async fetchScene(generation: number): Promise<void> {
    this.asked = generation;
    const had = this.world.version === "" ? "" : `?since=${this.world.version}`;
    const answer = await fetch(`/scene/${generation}${had}`, {
      headers: { Authorization: `Bearer ${this.token}` },
    });
    if (answer.status !== 200) throw new Error(`the scene is not there: ${answer.status}`);
    const file = (await answer.json()) as SceneFile;
    this.world.take(file);
    mark(this.element, "data-scene", String(generation));
    mark(this.element, "data-scene-part", file.scene ? "whole" : "changes");
    if (file.scene) this.box = file.scene;
    this.draw();
  }

  /** Puts the eye behind and above the robots, looking over them at the middle of the world. */
  private overview({ lower, upper }: SceneData): void {
    const corner = (k: number): [number, number] => [lower[k] ?? 0, upper[k] ?? 0];
    const [[x0, x1], [y0, y1]] = [corner(0), corner(1)];
    const centre = new THREE.Vector3((x0 + x1) / 2, (y0 + y1) / 2, 0);
    const places = [...this.world.robots.values()].map((first) =>
      new THREE.Vector3().setFromMatrixPosition(this.world.pose(first)),
    );
    const team = new THREE.Vector3();
    for (const place of places) team.addScaledVector(place, 1 / places.length);
    const ahead = centre.clone().sub(team).setZ(0);
    const far = Math.min(ahead.length(), 12);
    if (places.length === 0 || far < 1.5) {
      const away = Math.min(18, 0.5 * Math.hypot(x1 - x0, y1 - y0));
      this.camera.position
        .copy(centre)
        .add(new THREE.Vector3(-0.75, -0.35, 0.7).multiplyScalar(away));
      this.controls?.target.copy(centre);
    } else {
      ahead.normalize();
      this.camera.position
        .copy(team)
        .addScaledVector(ahead, -3 - 0.2 * far)
        .add(new THREE.Vector3(0, 0, 3 + 0.35 * far));
      this.controls?.target.copy(team).addScaledVector(ahead, 0.35 * far);
    }
    this.controls?.update();
    this.placed = true;
  }

  private poses(frame: Poses): void {
    this.heard = pageTime();
    if (!this.renderer) return;
    if (this.asked !== frame.generation)
      this.fetchScene(frame.generation).catch((error: unknown) => {
        console.warn(String(error));
        setTimeout(() => {
          this.asked = -1;
        }, 1000);
      });
    if (this.world.place(frame.generation, frame.poses, frame.time) < 2) return;
    if (!this.placed && this.box) this.overview(this.box);
    this.follow();
    this.draw();
  }

  /** Place (MuJoCo's frame) and heading of a robot: true where the scene tells it, else as reported. */
  private matrix(name: string): THREE.Matrix4 | null {
    const first = this.truth ? this.world.robots.get(name) : undefined;
    if (first !== undefined) return this.world.poses.length > 0 ? this.world.pose(first) : null;
    const pose = this.store.robots.find((robot) => robot.name === name)?.pose;
    return pose ? matrixOf(pose) : null;
  }

  private follow(): void {
    const matrix = this.matrix(this.store.selected);
    if (!matrix) return;
    const place = new THREE.Vector3().setFromMatrixPosition(matrix);
    if (this.mode === "follow" && this.controls) {
      const moved = place.clone().sub(this.followed);
      this.controls.target.add(moved);
      this.camera.position.add(moved);
      this.controls.update();
    } else if (this.mode === "first") {
      const ahead = new THREE.Vector3(1, 0, 0).transformDirection(matrix);
      this.camera.position
        .copy(place)
        .add(new THREE.Vector3(0, 0, 0.45))
        .addScaledVector(ahead, 0.3);
      this.camera.lookAt(this.camera.position.clone().add(ahead));
    }
    this.followed.copy(place);
  }

  /** Turns around the chosen robot from now on, from as far and as high as before. */
  private centre(): void {
    const matrix = this.matrix(this.store.selected);
    if (!matrix || !this.controls) return;
    const moved = new THREE.Vector3().setFromMatrixPosition(matrix).sub(this.controls.target);
    this.controls.target.add(moved);
    this.camera.position.add(moved);
    this.controls.update();
    this.placed = true;
    this.draw();
  }

  /**
   * Puts the eye behind and above the chosen robot, which stands in the lower middle of the picture; false where nobody
   * knows where it is.
   */
  private lookAtRobot(): boolean {
    const matrix = this.matrix(this.store.selected);
    if (!matrix) return false;
    const place = new THREE.Vector3().setFromMatrixPosition(matrix);
    const ahead = new THREE.Vector3(1, 0, 0).transformDirection(matrix).setZ(0).normalize();
    // The true world has walls behind which an eye further back would be.
    const [back, up, on] = this.truth ? [1.9, 2.9, 0.9] : [4.6, 3.9, 1.6];
    this.camera.position
      .copy(place)
      .addScaledVector(ahead, -back)
      .add(new THREE.Vector3(0, 0, up));
    this.controls?.target.copy(place).addScaledVector(ahead, on);
    this.controls?.update();
    this.followed.copy(place);
    this.placed = true;
    return true;
  }

  private reported(): void {
    if (!this.renderer) return;
    this.name();
    if (this.truth) return;
    const changed = this.reports.update();
    if (!this.placed && this.store.robot?.pose) this.lookAtRobot();
    this.follow();
    if (changed) this.draw();
  }

  /** Names above the robots. */
  private name(): void {
    const places = new Map<string, { at: THREE.Vector3; index: number; chosen: boolean }>();
    for (const { name, index } of this.store.robots) {
      const matrix = this.matrix(name);
      if (!matrix || (this.mode === "first" && name === this.store.selected)) continue;
      const at = new THREE.Vector3().setFromMatrixPosition(matrix);
      places.set(name, { at, index, chosen: name === this.store.selected });
    }
    this.labels.show(places);
  }

  /** Points of scans, once a second: they alone are no motion that would cost the picture its sharpness. */
  private cloud(): void {
    if (!this.renderer || pageTime() - this.clouded < CLOUD_S) return;
    this.clouded = pageTime();
    this.reports.cloud(this.dots);
    if (this.calm === 0) this.frame(true);
    else this.draw();
  }

  /** Fits the picture to its box, with `ratio` pixels for one of the page. */
  private resize(ratio: number): boolean {
    const { renderer, canvas, camera } = this;
    const [width, height] = [canvas.clientWidth, canvas.clientHeight];
    if (!renderer || width < 8 || height < 8) return false;
    if (ratio === this.ratio) return true;
    this.ratio = ratio;
    renderer.setPixelRatio(ratio);
    renderer.setSize(width, height, false);
    camera.aspect = width / height;
    camera.updateProjectionMatrix();
    return true;
  }

  /** Asks for a frame; it comes when the pace allows and no input waits. A sharp one follows when all is still. */
  draw(): void {
    clearTimeout(this.calm);
    if (this.pace.quality !== "full")
      this.calm = window.setTimeout(() => {
        this.calm = 0;
        if (!this.dirty) this.frame(true); // else it is not still: the next frame has to wait
      }, 1000 * STILL_S);
    else this.calm = 0;
    if (this.dirty || !this.renderer) return;
    this.dirty = true;
    setTimeout(
      () => requestAnimationFrame(() => this.frame(false)),
      1000 * this.pace.wait(pageTime()),
    );
  }

  private frame(sharp: boolean): void {
    const { renderer } = this;
    const { scheduling } = navigator as Navigator & {
      scheduling?: { isInputPending?: () => boolean };
    };
    if (scheduling?.isInputPending?.()) {
      setTimeout(() => this.frame(sharp), 4);
      return;
    }
    if (!sharp) this.dirty = false;
    const full = sharp || this.pace.quality === "full";
    if (!renderer || document.hidden) return;
    if (!this.resize(full ? Math.min(devicePixelRatio, 1.5) : 0.5)) return;
    const start = pageTime();
    this.scene.background = new THREE.Color(colour("sky"));
    renderer.render(this.scene, this.camera);
    mark(this.element, "data-sharp", full);
    // The frame is over when the GPU process is: software GL takes its time there, not here.
    const gl = renderer.getContext() as WebGL2RenderingContext;
    const sync = gl.fenceSync?.(gl.SYNC_GPU_COMMANDS_COMPLETE, 0);
    gl.flush();
    const done = (): void => {
      const waits =
        sync && gl.clientWaitSync(sync, 0, 0) === gl.TIMEOUT_EXPIRED && pageTime() - start < 2;
      if (waits) {
        setTimeout(done, 5);
        return;
      }
      if (sync) gl.deleteSync(sync);
      mark(this.element, "data-frames", String(Number(this.element.dataset.frames ?? 0) + 1));
      if (sharp || !this.pace.drew(start, pageTime())) return;
      mark(this.element, "data-quality", this.pace.quality);
      this.draw();
    };
    setTimeout(done, 0);
  }

  /** For tests: the points that are drawn, x, y, z one after another, in MuJoCo's frame. */
  cloudDrawn(): number[] {
    return [...(this.dots.geometry.getAttribute("position")?.array ?? [])];
  }

  /** For tests: where the eye is and what it looks at, x, y, z in MuJoCo's frame, and how. */
  eye(): { at: number[]; target: number[]; mode: Mode } {
    const target = this.controls?.target ?? new THREE.Vector3();
    return { at: this.camera.position.toArray(), target: target.toArray(), mode: this.mode };
  }

  /** For tests: where a robot's mesh is in the page, [x, y, z, qw, qx, qy, qz] in MuJoCo's frame, and of when. */
  poseOf(name: string): { time: number; pose: number[] } | null {
    const first = this.world.robots.get(name);
    if (first === undefined || this.world.poses.length === 0) return null;
    return { time: this.world.time, pose: [...this.world.poses.slice(7 * first, 7 * first + 7)] };
  }
}
