/* The rays of a batch, one after the other, against what stands and what moves. The same operations on the
   same numbers in the same order as in triangles.py, scenery.py and moving.py, which tell why; results
   are equal bit by bit (no contraction). */

#include <math.h>
#include <stdint.h>
#include <stdlib.h>

/* Those of triangles.py and culling.py. */
#define ROUNDED 1e-6
#define FAR 1e37
#define SLACK 1e-6
#define ROUNDING 1e-12
/* Rays for which trees are looked for together, at the most. */
#define TOGETHER 24

/* Embree's RTCRayHit. */
typedef struct {
  float origin[3], near, way[3], time, far;
  uint32_t mask, id, flags;
  float normal[3], u, v;
  uint32_t face, geometry, instance, within[3];
} __attribute__((aligned(16))) RayHit;

typedef void Intersect(void* scene, RayHit* ray, void* arguments);

/* A round part of a body, in the frame of the body. */
typedef struct {
  double centre[3], turn[9], axes[3];
} Round;

/* A TriangleScene. */
typedef struct {
  void* embree;
  const int64_t* parts; /* of each face */
  const double* normals;
  const int64_t* rounds; /* of each part, -1 if it is flat */
  const Round* shapes; /* NULL if there are none */
  const double* box; /* around everything: the least corner, the largest one */
} Scene;

/* A StaticGeometry. */
typedef struct {
  const Scene *full, *clear;
  int64_t count;
  const double* planes; /* normal, offset */
  const int64_t* geoms;
} Fixed;

/* What a DynamicGeometry has at one instant: trees, and bodies, one tree after the other. */
typedef struct {
  int64_t trees;
  const double *centres, *radii;
  const int64_t *first, *count;
  const double *turns, *places, *middles, *spans;
  const Scene *const *full, *const *clear;
  const int64_t *geoms, *geom_begins;
} Moving;

/* A RayBatch, and room for the answers; geoms of what moves are -2 - geom. */
typedef struct {
  Intersect* intersect;
  const Fixed* fixed;
  const Moving* moving;
  int64_t fans;
  const int64_t *begins, *point_begins;
  const double *points, *directions, *ranges;
  const int64_t* own;
  const uint8_t *through_glass, *facing;
  double *distances, *normals;
  int64_t* met;
} Work;

typedef struct {
  double distance, normal[3];
  int64_t part; /* -1 for a miss */
} Hit;

typedef struct {
  double near;
  int64_t tree;
} Candidate;

/* Rays of one fan; their start points follow on one another in steps of 3, or of 0. */
typedef struct {
  const double *origins, *ways;
  int step, count;
} Packet;

static double min(double a, double b) { return a < b ? a : b; }

static double max(double a, double b) { return a > b ? a : b; }

static double product(const double* a, const double* b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

static void away(const double* a, const double* from, double* found) {
  for (int i = 0; i < 3; i++) found[i] = a[i] - from[i];
}

static void turn_back(const double* turn, const double* v, double* found) {
  for (int i = 0; i < 3; i++) found[i] = v[0] * turn[i] + v[1] * turn[3 + i] + v[2] * turn[6 + i];
}

static void turn_out(const double* turn, const double* v, double* found) {
  for (int i = 0; i < 3; i++) found[i] = product(v, turn + 3 * i);
}

/* triangles._round_off */
static void round_off(const Round* shape, const double* o, const double* d, Hit* hit) {
  double start[3], way[3], outward[3];
  away(o, shape->centre, outward);
  turn_back(shape->turn, outward, start);
  turn_back(shape->turn, d, way);
  for (int i = 0; i < 3; i++) start[i] /= shape->axes[i], way[i] /= shape->axes[i];
  double a = product(way, way), b = product(start, way), c = product(start, start) - 1.0;
  double square = b * b - a * c, root = sqrt(max(square, 0.0));
  double near = (-b - root) / a, far = (-b + root) / a;
  hit->distance = near >= 0.0 ? near : far;
  for (int i = 0; i < 3; i++) outward[i] = (start[i] + hit->distance * way[i]) / shape->axes[i];
  turn_out(shape->turn, outward, hit->normal);
  double length = sqrt(product(hit->normal, hit->normal));
  for (int i = 0; i < 3; i++) hit->normal[i] /= length;
}

/* TriangleScene.cast */
static Hit cast(Intersect* intersect, const Scene* scene, const double* o, const double* d, double reach) {
  Hit hit = {.distance = INFINITY, .part = -1};
  if (!scene->embree) return hit;
  RayHit ray = {.mask = -1, .geometry = -1, .instance = -1};
  for (int i = 0; i < 3; i++) ray.origin[i] = (float)o[i], ray.way[i] = (float)d[i];
  reach *= 1.0 + ROUNDED;
  ray.far = (float)min(reach, FAR);
  intersect(scene->embree, &ray, NULL);
  if (ray.geometry == (uint32_t)-1) return hit;
  hit.distance = ray.far;
  hit.part = scene->parts[ray.face];
  for (int i = 0; i < 3; i++) hit.normal[i] = scene->normals[3 * (size_t)ray.face + i];
  if (scene->shapes && scene->rounds[hit.part] >= 0)
    round_off(scene->shapes + scene->rounds[hit.part], o, d, &hit);
  return hit;
}

/* scenery._meet */
static void meet_planes(const Fixed* fixed, const double* o, const double* d, Hit* hit) {
  for (int64_t i = 0; i < fixed->count; i++) {
    const double* plane = fixed->planes + 4 * i;
    double slope = product(d, plane), way = (plane[3] - product(o, plane)) / slope;
    if (!(way >= 0.0 && way < hit->distance && slope < 0.0)) continue;
    *hit = (Hit){way, {plane[0], plane[1], plane[2]}, fixed->geoms[i]};
  }
}

/* culling.passing */
static int passes(const double* o, const double* d, double reach, const double* centre, double radius) {
  double offset[3], wide = radius + SLACK;
  away(centre, o, offset);
  double ahead = product(offset, d), forward = ahead > 0.0 ? ahead : 0.0;
  return ahead - radius <= reach + SLACK &&
         forward * forward >= (1.0 - ROUNDING) * product(offset, offset) - wide * wide;
}

/* Whether a ray passes through a box within its reach. */
static int enters(const double* o, const double* d, double reach, const double* box) {
  double from = 0.0, to = reach + SLACK;
  for (int i = 0; i < 3; i++) {
    double slope = 1.0 / d[i], low = (box[i] - o[i]) * slope, high = (box[3 + i] - o[i]) * slope;
    double first = low < high ? low : high, last = low < high ? high : low;
    if (first > from) from = first;
    if (last < to) to = last;
  }
  return !(from > to);
}

/* The trees that some rays of a fan may meet, the nearest first; returns their number. */
static int reachable(const Work* w, int64_t fan, const Packet* rays, Candidate* found) {
  const Moving* m = w->moving;
  const double *first = rays->origins, *d = rays->ways;
  double off[3], axis[3] = {0.0, 0.0, 0.0}, spread = 0.0, cosine = 1.0;
  for (int i = 0; i < rays->count; i++) {
    away(first + i * rays->step, first, off);
    spread = max(spread, product(off, off));
    for (int k = 0; k < 3; k++) axis[k] += d[3 * i + k];
  }
  spread = sqrt(spread) + SLACK;
  double length = sqrt(product(axis, axis));
  for (int k = 0; k < 3; k++) axis[k] /= length;
  for (int i = 0; i < rays->count; i++) cosine = min(cosine, product(axis, d + 3 * i));
  cosine -= ROUNDING;
  double sine = cosine > 0.0 ? sqrt(1.0 - cosine * cosine) : NAN;
  int number = 0;
  for (int64_t tree = 0; tree < m->trees; tree++) {
    if (tree == w->own[fan]) continue;
    double wide = m->radii[tree] + spread, most = w->ranges[fan] + wide;
    away(m->centres + 3 * tree, first, off);
    double square = product(off, off);
    if (square > most * most) continue;
    double along = product(off, axis), beside = sqrt(max(square - along * along, 0.0));
    if (beside * cosine - along * sine > wide) continue; /* outside of the cone of the rays */
    Candidate one = {sqrt(square) - wide, tree};
    int place = number++;
    for (; place && found[place - 1].near > one.near; place--) found[place] = found[place - 1];
    found[place] = one;
  }
  return number;
}

/* What moves and is met first, of some trees. */
static Hit meet_moving(
  const Work* w, int64_t fan, const Candidate* trees, int number, const double* o, const double* d
) {
  const Moving* m = w->moving;
  const Scene* const* scenes = w->through_glass[fan] ? m->clear : m->full;
  double reach = w->ranges[fan];
  Hit nearest = {.distance = INFINITY};
  int64_t met = -1;
  for (const Candidate* one = trees; one < trees + number && one->near <= reach; one++) {
    int64_t tree = one->tree, body = m->first[tree], last = body + m->count[tree] - 1;
    if (!passes(o, d, reach, m->centres + 3 * tree, m->radii[tree])) continue;
    for (int several = body < last; body <= last; body++) {
      if (several && !passes(o, d, reach, m->middles + 3 * body, m->spans[body])) continue;
      double offset[3], start[3], way[3];
      away(o, m->places + 3 * body, offset);
      turn_back(m->turns + 9 * body, offset, start);
      turn_back(m->turns + 9 * body, d, way);
      const Scene* scene = scenes[body];
      double far = scene->shapes ? INFINITY : reach; /* round surfaces are nearer than their facets */
      if (!enters(start, way, far, scene->box)) continue;
      Hit hit = cast(w->intersect, scene, start, way, far);
      int equal = hit.distance == nearest.distance && body > met;
      if (hit.part < 0 || !(hit.distance < nearest.distance || equal)) continue;
      nearest = hit, met = body;
      reach = min(reach, hit.distance);
    }
  }
  if (met < 0) return nearest;
  Hit found = {.distance = nearest.distance, .part = -2 - m->geoms[m->geom_begins[met] + nearest.part]};
  turn_out(m->turns + 9 * met, nearest.normal, found.normal);
  return found;
}

/* Cast some rays of a fan that follow on one another. */
static void cast_some(const Work* w, int64_t fan, int64_t begin, const Packet* rays, Candidate* trees) {
  const Scene* fixed = w->through_glass[fan] ? w->fixed->clear : w->fixed->full;
  double range = w->ranges[fan];
  int number = reachable(w, fan, rays, trees);
  for (int i = 0; i < rays->count; i++) {
    int64_t ray = begin + i;
    const double *o = rays->origins + i * rays->step, *d = rays->ways + 3 * i;
    Hit moving = meet_moving(w, fan, trees, number, o, d);
    Hit hit = cast(w->intersect, fixed, o, d, min(range, moving.distance));
    meet_planes(w->fixed, o, d, &hit);
    if (moving.distance < hit.distance) hit = moving;
    int missed = hit.distance > range;
    w->distances[ray] = missed ? INFINITY : hit.distance;
    w->met[ray] = missed ? -1 : hit.part;
    if (!w->facing[fan]) continue;
    double sign = missed ? 0.0 : product(hit.normal, d) > 0.0 ? -1.0 : 1.0;
    for (int k = 0; k < 3; k++) w->normals[3 * ray + k] = hit.normal[k] * sign;
  }
}

/* Cast all rays; not 0 if there is no room. */
int cast_rays(const Work* w) {
  Candidate* trees = malloc((w->moving->trees + 1) * sizeof(Candidate));
  if (!trees) return 1;
  for (int64_t fan = 0; fan < w->fans; fan++) {
    int64_t begin = w->begins[fan], count = w->begins[fan + 1] - begin, point = w->point_begins[fan];
    int64_t parts = (count + TOGETHER - 1) / TOGETHER;
    int step = w->point_begins[fan + 1] - point > 1 ? 3 : 0;
    for (int64_t part = 0; part < parts; part++) {
      int64_t ray = count * part / parts, next = count * (part + 1) / parts;
      Packet rays = {w->points + 3 * point + ray * step, w->directions + 3 * (begin + ray), step, next - ray};
      cast_some(w, fan, begin + ray, &rays, trees);
    }
  }
  free(trees);
  return 0;
}
