// Where in the world something is that the operator sees in a picture: the picture tells its bearing, the scan
// how far it is. Pure.

import { type Pose, type Robot, type Scan, scanPoints, toWorld, type Vector } from "./protocol";

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
  const [x, y] = robot.camera?.mount ?? [0, 0, 0];
  const bearing = bearingOfColumn(robot, column);
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

/** The direction in which a column of a robot's picture looks, rad to the right of ahead. */
function bearingOfColumn(robot: Pick<Robot, "camera">, column: number): number {
  const fov = robot.camera?.fov ?? USUAL_FOV;
  return (robot.camera?.yaw ?? 0) + Math.atan(2 * column * Math.tan(fov / 2));
}

/** A place in the direction of a column where the laser saw nothing, 1 m away; null without a pose. */
export function guessOfColumn(
  robot: Pick<Robot, "pose" | "camera">,
  column: number,
): Vector | null {
  const { pose } = robot;
  return pose && placeFrom(pose, 1, bearingOfColumn(robot, column), pose[2]);
}

/** How far a place is from a robot, m, and in which direction, rad to the right of ahead. */
export function fromRobot(pose: Pose, place: Vector): { distance: number; bearing: number } {
  const [x, y] = [place[0] - pose[0], place[1] - pose[1]];
  const turn = Math.atan2(y, x) - pose[5];
  return { distance: Math.hypot(x, y), bearing: Math.atan2(Math.sin(turn), Math.cos(turn)) };
}

/** The place so far from a robot in a direction, at a height. */
export function placeFrom(pose: Pose, distance: number, bearing: number, z: number): Vector {
  const angle = pose[5] + bearing;
  return [pose[0] + distance * Math.cos(angle), pose[1] + distance * Math.sin(angle), z];
}

/** The column (-0.5 left to 0.5 right) of a robot's picture in which a place is; null outside of it. */
export function columnOfPlace(robot: Pick<Robot, "pose" | "camera">, place: Vector): number | null {
  if (!robot.pose) return null;
  const fov = robot.camera?.fov ?? USUAL_FOV;
  const [x, y] = robot.camera?.mount ?? [0, 0, 0];
  const { distance, bearing } = fromRobot(robot.pose, place);
  const seen = Math.atan2(distance * Math.sin(bearing) - y, distance * Math.cos(bearing) - x);
  const turn = seen - (robot.camera?.yaw ?? 0);
  const off = Math.atan2(Math.sin(turn), Math.cos(turn));
  if (Math.abs(off) >= fov / 2) return null;
  return Math.tan(off) / (2 * Math.tan(fov / 2));
}
