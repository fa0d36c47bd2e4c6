// Shapes, materials and textures of the true world, kept for as long as the page lives: a robot that joins needs
// new ones only for what was not there before.

import * as THREE from "three";
import { matt } from "./gl";

export interface Geom {
  shape: "plane" | "sphere" | "capsule" | "cylinder" | "ellipsoid" | "box" | "mesh";
  size?: number[];
  mesh?: string;
  pos?: number[];
  quat?: number[];
  material: number;
}

export interface Material {
  rgba: number[];
  texture?: string;
  repeat?: [number, number];
  uniform?: boolean;
  emission?: number;
}

export interface MeshData {
  vertices: string;
  faces: string;
  normals?: string;
  uv?: string;
}

export interface TextureData {
  shape?: string;
  format?: string;
  data?: string;
  mean?: number[];
}

const ENDLESS = 60;
/** Least area, m2, of a flat geom whose texture is drawn; smaller ones get its mean colour. */
const LARGE = 1;
/** Radius, m, from which on something round gets more corners. */
const BIG = 0.25;
/** Corners around something round, and rings of a ball: big and small. */
const CORNERS = { big: [20, 12], small: [14, 8] } as const;

export class Shapes {
  readonly meshes: Record<string, MeshData> = {};
  readonly textures: Record<string, TextureData> = {};
  /** Lamps are near: the light on a face differs from pixel to pixel. */
  lamps = false;
  private readonly geometries = new Map<string, THREE.BufferGeometry>();
  private readonly materials = new Map<string, THREE.Material>();
  private readonly images = new Map<string, THREE.Texture>();

  /** `loaded` is called when a texture has come. */
  constructor(private readonly loaded: () => void) {}

  /** What a geom is drawn with: the keys of its look, with its own texture where it is large enough. */
  look(
    geom: Geom,
    material: Material | undefined,
  ): { colour: THREE.Color; look: string; uv: string } {
    const rgba = material?.rgba ?? [0.6, 0.6, 0.6, 1];
    const alpha = Math.round(20 * (rgba[3] ?? 1)) / 20;
    const id = material?.texture ?? "";
    const told = this.textures[id];
    const [a = 0, b = 0] = geom.size ?? [];
    const flat = geom.shape === "plane" || geom.shape === "box";
    const wide = flat && 4 * (a || ENDLESS) * (b || ENDLESS) >= LARGE;
    const skinned = geom.shape === "mesh" && !!this.meshes[geom.mesh ?? ""]?.uv;
    const drawn = !!told?.data && told.shape !== "cube" && (wide || skinned);
    const mean = drawn ? [1, 1, 1] : (told?.mean ?? [1, 1, 1]);
    const part = (i: number): number => Math.min(1, (rgba[i] ?? 1) * (mean[i] ?? 1));
    const [s, t] = material?.repeat ?? [1, 1];
    const own = (half: number, repeat: number): number =>
      (material?.uniform ? (half || ENDLESS) * repeat : half ? repeat : ENDLESS * repeat) / 2;
    return {
      colour: new THREE.Color().setRGB(part(0), part(1), part(2), THREE.SRGBColorSpace),
      look: `${alpha}|${(material?.emission ?? 0) > 0.3 ? "glows" : ""}|${drawn ? id : ""}`,
      uv: drawn && flat ? `${own(a, s)}/${own(b, t)}` : "",
    };
  }

  material(look: string, shape: string): THREE.Material {
    const flat = shape.startsWith("mesh:") && !this.meshes[shape.slice(5)]?.normals;
    const key = `${look}|${flat}|${this.lamps}`;
    let material = this.materials.get(key);
    if (!material) {
      const [alpha = "1", glows = "", texture = ""] = look.split("|");
      const parameters = {
        transparent: Number(alpha) < 1,
        opacity: Number(alpha),
        flatShading: flat,
        map: texture === "" ? null : this.image(texture),
      };
      const each = flat || this.lamps;
      const made = each ? new THREE.MeshLambertMaterial(parameters) : matt(parameters);
      if (glows) made.emissive.setRGB(0.5, 0.5, 0.5);
      material = made;
      this.materials.set(key, material);
    }
    return material;
  }

  private image(id: string): THREE.Texture {
    let texture = this.images.get(id);
    if (!texture) {
      const made = new THREE.Texture();
      made.wrapS = made.wrapT = THREE.RepeatWrapping;
      made.colorSpace = THREE.SRGBColorSpace;
      made.anisotropy = 4;
      made.flipY = false; // the bitmap is already turned
      texture = made;
      this.images.set(id, texture);
      const { data = "", format = "png" } = this.textures[id] ?? {};
      createImageBitmap(new Blob([bytes(data)], { type: `image/${format}` }), {
        imageOrientation: "flipY",
      }).then(
        (image) => {
          made.image = image;
          made.needsUpdate = true;
          this.loaded();
        },
        () => console.warn(`texture ${id} is no picture`),
      );
    }
    return texture;
  }

  geometry(shape: string, uv: string): THREE.BufferGeometry {
    const key = `${shape}|${uv}`;
    let geometry = this.geometries.get(key);
    if (!geometry) {
      geometry = this.make(shape);
      if (uv !== "") lay(geometry, uv);
      this.geometries.set(key, geometry);
    }
    return geometry;
  }

  private make(shape: string): THREE.BufferGeometry {
    if (shape === "box") return new THREE.BoxGeometry(2, 2, 2);
    const [form, size] = shape.split("-");
    const [corners, rings] = CORNERS[size === "small" ? "small" : "big"];
    if (form === "sphere") return new THREE.SphereGeometry(1, corners, rings);
    // The ends of a capsule: halves of a ball, up and down.
    if (form === "top" || form === "bottom") {
      const begin = form === "top" ? 0 : Math.PI / 2;
      const [whole, half] = [2 * Math.PI, Math.PI / 2];
      return new THREE.SphereGeometry(1, corners, rings / 2, 0, whole, begin, half).rotateX(half);
    }
    if (form === "cylinder" || form === "tube")
      return new THREE.CylinderGeometry(1, 1, 2, corners, 1, form === "tube").rotateX(Math.PI / 2);
    if (shape === "plane") return new THREE.PlaneGeometry(2, 2);
    const geometry = new THREE.BufferGeometry();
    const data = this.meshes[shape.slice(5)];
    if (!data) return geometry;
    const vertices = new Float32Array(bytes(data.vertices));
    geometry.setAttribute("position", new THREE.BufferAttribute(vertices, 3));
    const faces = bytes(data.faces);
    const index = vertices.length / 3 <= 65536 ? new Uint16Array(faces) : new Uint32Array(faces);
    geometry.setIndex(new THREE.BufferAttribute(index, 1));
    if (data.normals)
      geometry.setAttribute(
        "normal",
        new THREE.BufferAttribute(new Int8Array(bytes(data.normals)), 3, true),
      );
    else geometry.computeVertexNormals();
    if (data.uv) {
      const uv = new Float32Array(bytes(data.uv)).map((value, i) => (i % 2 ? 1 - value : value));
      geometry.setAttribute("uv", new THREE.BufferAttribute(uv, 2));
    }
    return geometry;
  }
}

/** Lays a texture by x and y of a unit shape: s = 0.5 + x k, t down = 0.5 - y l. */
function lay(geometry: THREE.BufferGeometry, uv: string): void {
  const [k = 0.5, l = 0.5] = uv.split("/").map(Number);
  const place = geometry.getAttribute("position");
  const coordinates = new Float32Array(2 * place.count);
  for (let i = 0; i < place.count; i++)
    coordinates.set([0.5 + place.getX(i) * k, 0.5 + place.getY(i) * l], 2 * i);
  geometry.setAttribute("uv", new THREE.BufferAttribute(coordinates, 2));
}

/** A geom as unit shapes (half extent 1) with offset and scale; a capsule is a tube and two halves of a ball. */
export function pieces(geom: Geom): [string, THREE.Vector3, THREE.Vector3][] {
  const [a = 0, b = 0, c = 0] = geom.size ?? [];
  const v = (x: number, y: number, z: number): THREE.Vector3 => new THREE.Vector3(x, y, z);
  const none = v(0, 0, 0);
  const wide = geom.shape === "ellipsoid" ? Math.max(a, b, c) : a;
  const size = wide < BIG ? "small" : "big";
  switch (geom.shape) {
    case "plane":
      return [["plane", none, v(a || ENDLESS, b || ENDLESS, 1)]];
    case "sphere":
      return [[`sphere-${size}`, none, v(a, a, a)]];
    case "ellipsoid":
      return [[`sphere-${size}`, none, v(a, b, c)]];
    case "box":
      return [["box", none, v(a, b, c)]];
    case "cylinder":
      return [[`cylinder-${size}`, none, v(a, a, b)]];
    case "capsule":
      return [
        [`tube-${size}`, none, v(a, a, b)],
        [`top-${size}`, v(0, 0, b), v(a, a, a)],
        [`bottom-${size}`, v(0, 0, -b), v(a, a, a)],
      ];
    case "mesh":
      return [[`mesh:${geom.mesh ?? ""}`, none, v(1, 1, 1)]];
  }
}

export function vector(pos: number[] = [0, 0, 0]): THREE.Vector3 {
  return new THREE.Vector3(pos[0], pos[1], pos[2]);
}

export function quaternion(quat: number[] = [1, 0, 0, 0]): THREE.Quaternion {
  return new THREE.Quaternion(quat[1], quat[2], quat[3], quat[0]);
}

function bytes(base64: string): ArrayBuffer {
  return Uint8Array.from(atob(base64), (c) => c.charCodeAt(0)).buffer;
}
