// What draws WebGL here: nothing, a graphics card, or the processors (llvmpipe, SwiftShader), which everything else
// needs as well. Materials that are cheap for these.

import * as THREE from "three";

export interface Graphics {
  webgl: boolean;
  /** The processors draw: each pixel is paid for with time of theirs. */
  software: boolean;
}

let found: Graphics | null = null;

/** Looks once; three.js would tell the browser's log of each failure. */
export function graphics(): Graphics {
  if (found) return found;
  const gl = document.createElement("canvas").getContext("webgl2");
  found = { webgl: gl !== null, software: gl !== null && isSoftware(rendererOf(gl)) };
  gl?.getExtension("WEBGL_lose_context")?.loseContext();
  return found;
}

function rendererOf(gl: WebGL2RenderingContext): string {
  const told = gl.getExtension("WEBGL_debug_renderer_info");
  return String(gl.getParameter(told ? told.UNMASKED_RENDERER_WEBGL : gl.RENDERER));
}

/** Whether a renderer's name is that of one without a graphics card. */
export function isSoftware(renderer: string): boolean {
  return /llvmpipe|softpipe|swiftshader|swrast|software|basic render/i.test(renderer);
}

const LIT = "varying vec3 vLit;\n";
const SUM = `
  vec3 turned = normalize(transformedNormal);
  vec3 lit = ambientLightColor;
  #if NUM_HEMI_LIGHTS > 0
  for (int i = 0; i < NUM_HEMI_LIGHTS; i++) lit += getHemisphereLightIrradiance(hemisphereLights[i], turned);
  #endif
  #if NUM_DIR_LIGHTS > 0
  for (int i = 0; i < NUM_DIR_LIGHTS; i++)
    lit += saturate(dot(turned, directionalLights[i].direction)) * directionalLights[i].color;
  #endif
  vLit = RECIPROCAL_PI * lit;
`;

/**
 * Lambert's law at the corners instead of at each pixel: the same picture of flat faces, under lights that shine
 * from one direction, for a third of what the pixels cost software GL.
 */
export function matt(parameters: THREE.MeshLambertMaterialParameters): THREE.MeshLambertMaterial {
  const material = new THREE.MeshLambertMaterial(parameters);
  material.onBeforeCompile = (shader) => {
    shader.vertexShader = shader.vertexShader
      .replace("void main()", `${LIT}#include <lights_pars_begin>\nvoid main()`)
      .replace("#include <fog_vertex>", `#include <fog_vertex>\n${SUM}`);
    shader.fragmentShader = shader.fragmentShader
      .replace("void main()", `${LIT}void main()`)
      .replace(/#include <(bsdfs|lights_\w+|normal_\w+|shadowmap_pars_fragment)>/g, "")
      .replace("ReflectedLight reflectedLight", "// ReflectedLight")
      .replace(
        "reflectedLight.directDiffuse + reflectedLight.indirectDiffuse",
        "diffuseColor.rgb * vLit",
      );
  };
  material.customProgramCacheKey = () => "matt";
  return material;
}
