/* Servos and contact compensation between the halves of MuJoCo's steps, as a callback of it, so
   that several steps are one call. The same operations on the same numbers in the same order as in
   servos.py, joint_servos.py and ground.py, which tell why; results are equal bit by bit (no contraction). */

#include <math.h>
#include <stdint.h>
#include <mujoco/mujoco.h>

/* Joints that are no wheels; __init__.py has the same fields here and below. */
typedef struct {
  double gain, settled_speed, arrived_speed, stalled, dead_speed;
  const double *low, *high, *max_speed, *slew, *target, *rate;
  double *speed, *here, *shift;
  const uint8_t* positioned;
  uint8_t* under_way;
  const int64_t *coordinates, *dofs;
  int32_t count, hold_steps, waited, holding, settled, moving;
} Joints;

/* What is worked on. */
typedef struct {
  const mjModel* model;
  mjData* data;
  Joints* joints; /* NULL: there are none */
  double timestep, seen, gain, most, limit;
  const double *target, *increment, *decrement, *delay;
  double *setpoint, *idle, *hold, *shift;
  const uint8_t* engaged;
  const int64_t *angles, *dofs;
  int32_t wheels, steady, moving, compensate, calls;
} Work;

/* The callback is one of the whole process, so it asks whose state comes. */
static __thread Work* current;

void control(const mjModel* m, mjData* d);

/* Help with this thread's steps of a state from now on; 0, and no help, while the callback is another's. */
int enter(Work* work, mjData* data, int steady, int moving) {
  if (!mjcb_control) mjcb_control = control;
  if (mjcb_control != control) return 0;
  work->data = data;
  work->seen = NAN;
  work->steady = steady;
  work->moving = moving;
  work->calls = 0;
  current = work;
  return 1;
}

/* divergence.is_sound */
static int sound(const mjModel* m, const mjData* d, double limit) {
  for (int i = 0; i < m->nv; i++)
    if (!(fabs(d->qvel[i]) < limit)) return 0;
  for (int i = 0; i < m->nq; i++)
    if (!isfinite(d->qpos[i])) return 0;
  return 1;
}

/* Help no more. The sum of 1 if the wheels are steady, 2 if any turns, 4 if the state is sound; -1 if
   there were other than so many steps. */
int leave(int steps) {
  Work* w = current;
  current = NULL;
  if (w->calls != steps) return -1;
  return w->steady | w->moving << 1 | (steps && sound(w->model, w->data, w->limit)) << 2;
}

static double clipped(double value, double most) {
  return value < -most ? -most : value > most ? most : value;
}

/* WheelServos.update */
static void update(Work* w, const double* qpos) {
  int standing = 0, changing = 0;
  for (int i = 0; i < w->wheels; i++) {
    double change = w->target[i] - w->setpoint[i];
    double most = change * w->setpoint[i] < 0.0 ? w->decrement[i] : w->increment[i];
    change = clipped(change, most);
    changing |= change != 0.0;
    w->setpoint[i] += change;
    double speed = w->setpoint[i], angle = qpos[w->angles[i]];
    int still = speed == 0.0 && w->target[i] == 0.0 && w->engaged[i];
    standing |= still;
    w->idle[i] = still ? w->idle[i] + w->timestep : 0.0;
    if (still && w->idle[i] >= w->delay[i]) {
      if (isnan(w->hold[i])) w->hold[i] = angle;
      speed = clipped(w->gain * (w->hold[i] - angle), w->most);
    } else {
      w->hold[i] = NAN;
    }
    w->shift[w->dofs[i]] = speed;
  }
  w->moving = 0;
  for (int i = 0; i < w->wheels; i++) w->moving |= w->shift[w->dofs[i]] != 0.0;
  w->steady = !(standing || changing);
}

/* JointServos._update */
static void advance(Joints* j, const double* qpos) {
  if (j->holding && j->waited < j->hold_steps) {
    j->waited++;
    return;
  }
  int same = j->settled;
  for (int i = 0; same && i < j->count; i++) same = qpos[j->coordinates[i]] == j->here[i];
  int holding = 1, settled = 1, moving = 0;
  for (int i = 0; !same && i < j->count; i++) {
    double here = qpos[j->coordinates[i]], most = j->max_speed[i];
    double gone = fabs(here - j->here[i]);
    j->here[i] = here;
    double wish = clipped(j->positioned[i] ? j->gain * (j->target[i] - here) : j->rate[i], most);
    double up = j->gain * (j->low[i] - here), down = j->gain * (j->high[i] - here);
    if (most < up) up = most;
    if (wish < up) wish = up;
    if (down < -most) down = -most;
    if (down < wish) wish = down;
    double limit = j->holding ? j->slew[i] * j->waited : j->slew[i];
    double speed = j->speed[i] + clipped(wish - j->speed[i], limit);
    double size = fabs(speed), fastest = fabs(wish) > size ? fabs(wish) : size;
    int there = speed == wish, turns = !(size < j->dead_speed);
    j->speed[i] = speed;
    j->under_way[i] = fastest >= j->arrived_speed && !(there && gone < j->stalled);
    j->shift[j->dofs[i]] = turns ? speed : 0.0;
    holding &= fastest < j->settled_speed;
    settled &= there;
    moving |= turns;
  }
  j->waited = 1;
  if (same) return;
  j->holding = holding;
  j->settled = holding && settled;
  j->moving = moving;
}

/* Servos.between */
static void shift(mjData* d, const double* by) {
  for (int row = d->ne; row < d->ne + d->nf; row++)
    if (d->efc_type[row] == mjCNSTR_FRICTION_DOF)
      d->efc_aref[row] += by[d->efc_id[row]] * d->efc_KBIP[4 * row + 1];
}

/* ground.compensate */
static void compensate(const mjModel* m, mjData* d) {
  if (!d->ncon) return;
  double* aref = d->efc_aref;
  mj_markStack(d);
  double* moved = mj_stackAllocNum(d, d->nefc);
  mj_mulJacVec(m, d, moved, d->qacc_warmstart);
  for (int i = 0; i < d->ncon; i++) {
    const mjContact* c = d->contact + i;
    int row = c->efc_address;
    if (row < 0 || c->dim < 3) continue;
    double one = aref[row + 1], two = aref[row + 2];
    double squares = one * one + two * two;
    double left = one - moved[row + 1], beside = two - moved[row + 2];
    left = left * left + beside * beside;
    if (squares < left || isnan(squares)) left = squares;
    aref[row] -= sqrt(left) * c->friction[0];
  }
  mj_freeStack(d);
}

void control(const mjModel* m, mjData* d) {
  Work* w = current;
  if (!w || w->data != d) return;
  /* A second time in one step it is called for trees that have just fallen asleep. */
  if (d->time == w->seen) return;
  w->seen = d->time;
  w->model = m;
  w->calls++;
  if (!w->steady) update(w, d->qpos);
  if (w->moving) shift(d, w->shift);
  if (w->joints) {
    /* Before the first of the steps numpy has advanced them. */
    if (w->calls > 1) advance(w->joints, d->qpos);
    if (w->joints->moving) shift(d, w->joints->shift);
  }
  if (w->compensate) compensate(m, d);
}
