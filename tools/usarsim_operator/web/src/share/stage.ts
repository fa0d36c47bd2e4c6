// The run in 3D: the world's own shapes where they were kept, else walls of the floor; robots and victims where the
// truth had them. Drawn when something has changed.

import * as THREE from "three";
import { OrbitControls } from "three/examples/jsm/controls/OrbitControls.js";
import { choice, colour, h, mark, panel, say } from "../dom";
import { graphics, matt } from "../gl";
import { robotColour } from "../looks";
import { Labels, plainBody } from "../reports";
import { World } from "../scene";
import type { Scenery } from "./packed";
import type { Finding, Pose, Run } from "./run";

type Eye = "orbit" | "follow" | "first";

/** Where what is not there is put, m. */
const AWAY = -1000;
const WALL_M = 0.6;
/** Corners of a robot's way, at most: rows between them are left out. */
const CORNERS = 4000;
/** Size of the picture while it moves, where the processors draw. */
const COARSE = 0.6;
const STILL_MS = 300;

/** Poses of a robot's bodies in the frame of its first one. */
interface Rigid {
  first: number;
  bodies: THREE.Matrix4[];
}

export class Stage {
  readonly element: HTMLElement;
  /** Frames so far, for tests. */
  frames = 0;
  private readonly canvas = h("canvas", { role: "img", "aria-label": "3D view", tabindex: "0" });
  private readonly note = h("p", { class: "empty" });
  private readonly scene = new THREE.Scene();
  private readonly camera = new THREE.PerspectiveCamera(55, 1, 0.05, 400);
  private readonly labels = new Labels();
  private readonly world = new World(() => this.draw());
  private readonly rigid = new Map<string, Rigid>();
  private readonly plain = new Map<string, THREE.Mesh>();
  private readonly ways: THREE.Line[] = [];
  private readonly flags: THREE.Mesh[] = [];
  private readonly walkers: { victim: number; pose: number; from: THREE.Vector3 }[] = [];
  private readonly poses: Float32Array;
  private renderer: THREE.WebGLRenderer | null = null;
  private controls: OrbitControls | null = null;
  private eye: Eye = "orbit";
  private time = 0;
  private asked = false;
  /** Until somebody moves the eye it sees everything, however large the picture becomes. */
  private untouched = true;
  private calm = 0;
  private readonly followed = new THREE.Vector3();

  constructor(
    private readonly run: Run,
    private readonly chosen: () => number,
  ) {
    const modes = choice(
      "eye",
      { orbit: "Orbit", follow: "Follow", first: "First person" },
      "orbit",
      (eye) => this.look(eye),
    );
    const whole = h("button", { type: "button", onclick: () => this.overview() }, "Whole");
    const stage = h("div", { class: "stage" }, this.canvas, this.note);
    this.element = panel("share3d", "3D", [modes, whole], stage);
    const { scenery } = run.contents;
    this.poses = Float32Array.from(scenery?.poses ?? []);
    this.camera.up.set(0, 0, 1);
    if (scenery) this.furnish(scenery);
    else this.build();
    this.people();
    this.start();
  }

  private start(): void {
    if (!graphics().webgl) {
      say(this.note, "no WebGL here: the map below shows the same places");
      mark(this.element, "data-webgl", false);
      return;
    }
    this.renderer = new THREE.WebGLRenderer({
      canvas: this.canvas,
      antialias: !graphics().software,
      powerPreference: "low-power",
    });
    mark(this.element, "data-webgl", true);
    this.scene.add(this.world.group, this.labels.group);
    this.controls = new OrbitControls(this.camera, this.canvas);
    this.controls.maxPolarAngle = 1.55;
    this.controls.addEventListener("change", () => this.draw());
    new ResizeObserver(() => {
      if (this.untouched) this.overview();
      else this.draw();
    }).observe(this.canvas);
    this.controls.addEventListener("start", () => {
      this.untouched = false;
    });
    this.overview();
  }

  /** The world as the server showed it when the trial began. */
  private furnish(scenery: Scenery): void {
    const { scene, kinds, meshes, textures, poses, things } = scenery;
    const present = {
      generation: 0,
      count: poses.length / 7,
      things: things.map((one, id) => ({ ...one, id })),
    };
    this.world.take({
      generation: 0,
      epoch: "",
      since: null,
      scene,
      kinds,
      meshes,
      textures,
      present,
    });
    for (const { what, name, kind, first } of things) {
      if (what !== "robot") continue;
      const own = this.matrix(first).invert();
      const bodies = (kinds[kind]?.bodies ?? []).map((_, i) =>
        this.matrix(first + i).premultiply(own),
      );
      this.rigid.set(name, { first, bodies });
    }
    const since = scenery.time - this.run.contents.began;
    scene.bodies.forEach((body, pose) => {
      const victim = this.run.contents.victims.findIndex((one) => one.name === body.name);
      if (body.what !== "victim" || victim < 0) return;
      const there = new THREE.Vector3(...this.run.victim(victim, since));
      const from = new THREE.Vector3().setFromMatrixPosition(this.matrix(pose)).sub(there);
      this.walkers.push({ victim, pose, from });
    });
  }

  /** Without scenery: the floor that robots reach, with its walls. */
  private build(): void {
    const sun = new THREE.DirectionalLight(0xffffff, 1.6);
    sun.position.set(-4, 6, 12);
    this.scene.add(new THREE.HemisphereLight(0xffffff, 0x777788, 2), sun);
    const { floor } = this.run.contents;
    if (!floor) return;
    const cells = this.run.array("floor");
    const { x, y, cell, rows, columns } = floor;
    const boxes: [number, number, number][] = [];
    // Walls of a row that touch are one block.
    for (let row = 0; row < rows; row++)
      for (let column = 0; column < columns; column++) {
        const first = column;
        while (column < columns && cells[row * columns + column] === 2) column++;
        if (column > first)
          boxes.push([x + ((first + column) / 2) * cell, y + (row + 0.5) * cell, column - first]);
      }
    const paint = matt({ color: colour("block") });
    const blocks = new THREE.InstancedMesh(
      new THREE.BoxGeometry(cell, cell, WALL_M),
      paint,
      boxes.length,
    );
    blocks.frustumCulled = false;
    boxes.forEach(([bx, by, length], i) => {
      const matrix = new THREE.Matrix4().makeScale(length, 1, 1);
      blocks.setMatrixAt(i, matrix.setPosition(bx, by, WALL_M / 2));
    });
    const ground = new THREE.Mesh(
      new THREE.PlaneGeometry(columns * cell, rows * cell),
      matt({ color: colour("floor") }),
    );
    ground.position.set(x + (columns * cell) / 2, y + (rows * cell) / 2, 0);
    this.scene.add(ground, blocks);
  }

  /** Ways of the robots, plain bodies for those without a shape, flags above victims. */
  private people(): void {
    this.run.contents.robots.forEach(({ name }, number) => {
      const tint = robotColour(number);
      if (!this.rigid.has(name)) {
        const body = plainBody("ground", tint);
        this.plain.set(name, body);
        this.scene.add(body);
      }
      const points: number[] = [];
      const { times } = this.run;
      const every = Math.max(1, Math.ceil(times.length / CORNERS));
      for (let row = 0; row < times.length; row += every) {
        const pose = this.run.pose(number, times[row] ?? 0);
        const last = points.slice(-3);
        if (pose) points.push(pose[0], pose[1], pose[2]);
        else points.push(...(last.length === 3 ? last : [0, 0, AWAY]));
      }
      const shape = new THREE.BufferGeometry();
      shape.setAttribute("position", new THREE.Float32BufferAttribute(points, 3));
      const way = new THREE.Line(shape, new THREE.LineBasicMaterial({ color: tint }));
      way.frustumCulled = false;
      way.userData.every = every;
      this.ways.push(way);
      this.scene.add(way);
    });
    for (const _ of this.run.contents.victims) {
      const flag = new THREE.Mesh(
        new THREE.ConeGeometry(0.16, 0.4, 4).rotateX(-Math.PI / 2),
        new THREE.MeshBasicMaterial(),
      );
      this.flags.push(flag);
      this.scene.add(flag);
    }
  }

  /** The pose of body number n, as kept. */
  private matrix(n: number): THREE.Matrix4 {
    return matrixOf([...this.poses.subarray(7 * n, 7 * n + 7)] as Pose);
  }

  /** Puts everything where it was at a time, s since the trial began. */
  show(time: number): void {
    this.time = time;
    if (!this.renderer) return;
    const { run } = this;
    const places = new Map<string, { at: THREE.Vector3; index: number; chosen: boolean }>();
    const poses = this.poses.slice();
    run.contents.robots.forEach(({ name }, number) => {
      const pose = run.pose(number, time);
      const body = pose ? matrixOf(pose) : new THREE.Matrix4().setPosition(0, 0, AWAY);
      const rigid = this.rigid.get(name);
      rigid?.bodies.forEach((own, i) => {
        write(poses, rigid.first + i, own.clone().premultiply(body));
      });
      const plain = this.plain.get(name);
      if (plain) {
        plain.matrix.copy(body);
        plain.visible = pose !== null;
      }
      const at = new THREE.Vector3().setFromMatrixPosition(body);
      const chosen = number === this.chosen();
      if (pose && !(this.eye === "first" && chosen))
        places.set(name, { at, index: number, chosen });
      const way = this.ways[number];
      way?.geometry.setDrawRange(0, Math.floor(run.row(time) / Number(way.userData.every)) + 1);
    });
    for (const { victim, pose, from } of this.walkers) {
      const there = new THREE.Vector3(...run.victim(victim, time)).add(from);
      poses.set([there.x, there.y, there.z], 7 * pose);
    }
    this.flags.forEach((flag, number) => {
      const [x, y, z] = run.victim(number, time);
      flag.position.set(x, y, z + 1.4);
      (flag.material as THREE.MeshBasicMaterial).color.set(
        findingColour(run.finding(number, time)),
      );
    });
    this.labels.show(places);
    if (run.contents.scenery) this.world.place(0, poses, time + run.contents.began);
    this.follow();
    this.draw();
  }

  private look(eye: Eye): void {
    this.eye = eye;
    this.untouched = false;
    if (this.controls) this.controls.enabled = eye !== "first";
    if (eye === "follow") this.behind();
    this.show(this.time);
  }

  /** Puts the eye so that the whole world is seen. */
  private overview(): void {
    const { scenery, floor } = this.run.contents;
    let [x0, y0, x1, y1] = [-8, -8, 8, 8];
    if (floor) {
      [x0, y0] = [floor.x, floor.y];
      [x1, y1] = [x0 + floor.columns * floor.cell, y0 + floor.rows * floor.cell];
    } else if (scenery) {
      [[x0 = 0, y0 = 0], [x1 = 0, y1 = 0]] = [scenery.scene.lower, scenery.scene.upper];
    }
    const centre = new THREE.Vector3((x0 + x1) / 2, (y0 + y1) / 2, 0);
    const corners = [x0, x1].flatMap((x) => [y0, y1].map((y) => new THREE.Vector3(x, y, 0)));
    const { camera, canvas } = this;
    camera.aspect = Math.max(1, canvas.clientWidth) / Math.max(1, canvas.clientHeight);
    camera.updateProjectionMatrix();
    // As the map has it, x to the right; or along x, where the floor is deeper than wide. Back until it is all seen.
    const wide = x1 - x0 >= y1 - y0;
    const aside = wide
      ? new THREE.Vector3(-0.08, -0.62, 0.78)
      : new THREE.Vector3(-0.62, 0.08, 0.78);
    for (let away = 4; away < 400; away *= 1.04) {
      camera.position.copy(centre).addScaledVector(aside, away);
      camera.lookAt(centre);
      camera.updateMatrixWorld();
      const far = corners.map((one) => one.clone().project(camera));
      if (far.every(({ x, y, z }) => z < 1 && Math.abs(x) < 0.96 && Math.abs(y) < 0.92)) break;
    }
    this.controls?.target.copy(centre);
    this.controls?.update();
    this.draw();
  }

  /** Puts the eye behind and above the chosen robot. */
  behind(): void {
    const pose = this.run.pose(this.chosen(), this.time);
    if (!pose || this.eye === "orbit") return;
    const matrix = matrixOf(pose);
    const place = new THREE.Vector3().setFromMatrixPosition(matrix);
    const ahead = new THREE.Vector3(1, 0, 0).transformDirection(matrix).setZ(0).normalize();
    this.camera.position
      .copy(place)
      .addScaledVector(ahead, -3.2)
      .add(new THREE.Vector3(0, 0, 3.4));
    this.controls?.target.copy(place).addScaledVector(ahead, 0.9);
    this.controls?.update();
    this.followed.copy(place);
  }

  private follow(): void {
    const pose = this.eye === "orbit" ? null : this.run.pose(this.chosen(), this.time);
    if (!pose) return;
    const matrix = matrixOf(pose);
    const place = new THREE.Vector3().setFromMatrixPosition(matrix);
    if (this.eye === "follow" && this.controls) {
      const moved = place.clone().sub(this.followed);
      this.controls.target.add(moved);
      this.camera.position.add(moved);
      this.controls.update();
    } else {
      const ahead = new THREE.Vector3(1, 0, 0).transformDirection(matrix);
      const up = new THREE.Vector3(0, 0, 1).transformDirection(matrix);
      this.camera.position.copy(place).addScaledVector(up, 0.45).addScaledVector(ahead, 0.3);
      this.camera.lookAt(this.camera.position.clone().add(ahead));
    }
    this.followed.copy(place);
  }

  /** Asks for a frame: a coarse one where the processors draw, a sharp one once all is still. */
  draw(): void {
    if (!this.renderer) return;
    clearTimeout(this.calm);
    if (graphics().software) this.calm = window.setTimeout(() => this.frame(true), STILL_MS);
    if (this.asked) return;
    this.asked = true;
    requestAnimationFrame(() => {
      this.asked = false;
      this.frame(!graphics().software);
    });
  }

  private frame(sharp: boolean): void {
    const { renderer, canvas, camera } = this;
    const [width, height] = [canvas.clientWidth, canvas.clientHeight];
    if (!renderer || width < 8 || height < 8) return;
    renderer.setPixelRatio(sharp ? Math.min(devicePixelRatio, 2) : COARSE);
    renderer.setSize(width, height, false);
    camera.aspect = width / height;
    camera.updateProjectionMatrix();
    this.scene.background = new THREE.Color(colour("sky"));
    renderer.render(this.scene, camera);
    this.frames++;
    mark(this.element, "data-sharp", sharp);
  }

  /** For tests: where a robot's mesh is, x, y, z. */
  placeOf(number: number): number[] {
    const name = this.run.contents.robots[number]?.name ?? "";
    const rigid = this.rigid.get(name);
    const matrix = rigid ? this.world.pose(rigid.first) : this.plain.get(name)?.matrix;
    return matrix ? new THREE.Vector3().setFromMatrixPosition(matrix).toArray() : [];
  }
}

export function findingColour(finding: Finding): string {
  return { missing: "#ffffff", found: "#e69f00", credited: "#009e73" }[finding];
}

function matrixOf([x, y, z, qw, qx, qy, qz]: Pose): THREE.Matrix4 {
  return new THREE.Matrix4().compose(
    new THREE.Vector3(x, y, z),
    new THREE.Quaternion(qx, qy, qz, qw),
    new THREE.Vector3(1, 1, 1),
  );
}

function write(poses: Float32Array, n: number, matrix: THREE.Matrix4): void {
  const [place, turn] = [new THREE.Vector3(), new THREE.Quaternion()];
  matrix.decompose(place, turn, new THREE.Vector3());
  poses.set([place.x, place.y, place.z, turn.w, turn.x, turn.y, turn.z], 7 * n);
}
