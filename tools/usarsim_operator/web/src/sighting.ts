// Where in the world something is that the operator sees in a picture: the picture tells its bearing, the scan
// how far it is. Pure.

import { type Robot, type Scan, scanPoints, toWorld, type Vector } from "./protocol";

/** Horizontal field of view of a camera that tells none, rad. */
const USUAL_FOV = 0.8;
/** A beam that ends further beside the line of sight than this says nothing about it, rad. */
const NEAR = 0.06;

/**
 * The place where the sight through a picture's column (-0.5 left to 0.5 right) meets what the laser saw, in the
 * world; null where it met nothing or where pose or scan are unknown. Camera and laser stand at different
 * places of the robot, so each beam's end is looked at from the camera.
 */
export function placeOfColumn(
  robot: Pick<Robot, "pose" | "camera">,
  column: number,
  scan: Scan | undefined,
): Vector | null {
  if (!robot.pose || !scan) return null;
  const fov = robot.camera?.fov ?? USUAL_FOV;
  const [x, y] = robot.camera?.mount ?? [0, 0, 0];
  const bearing = (robot.camera?.yaw ?? 0) + Math.atan(2 * column * Math.tan(fov / 2));
  let best: Vector | null = null;
  let nearest = NEAR;
  for (const { point, hit } of scanPoints(scan)) {
    const turn = Math.atan2(point[1] - y, point[0] - x) - bearing;
    const off = Math.abs(Math.atan2(Math.sin(turn), Math.cos(turn)));
    if (off >= nearest) continue;
    nearest = off;
    best = hit ? point : null;
  }
  return best && toWorld(robot.pose, best);
}
