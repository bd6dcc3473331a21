/* An interrupt runs the filter, another task looks at what it says, and the controller goes over to
 * the estimate without a bump. The interrupt is never interrupted by those that read.
 * ambkit export c zittau_axial --filter expert.json --out out/ */
#include "zittau_axial.h"

/* What the other tasks see. Volatile: each access is one, and none is moved past another. */
typedef struct seen {
  zittau_axial_estimates now;
  amb_real std[AMB_STATES];
  amb_status status; /* all flags since the last look */
} seen;

static zittau_axial_state filter; /* the interrupt's alone */
static volatile seen latest;
static volatile unsigned int written; /* counts the interrupt's turns */
static volatile bool start_anew;      /* asked for by another task */

/* ---- In the interrupt ---- */

/* Share of the estimate in what is fed back [1]: from 0 to 1 within so many samples, and at once to
 * 0 where it must not be. */
#define SAMPLES_TO_GO_OVER 100.0F

static amb_real share;

/* The position and the velocity that the controller gets: those by the measurement at first, and
 * the estimate's little by little. Its integral stays what it is, and its output has no step. */
static void go_over(const zittau_axial_estimates *now, amb_real *x, amb_real *v)
{
  share = now->feed_back ? amb_clamp(share + 1.0F / SAMPLES_TO_GO_OVER, 0.0F, 1.0F) : 0.0F;
  *x += share * (now->x - *x);
  *v += share * (now->v - *v);
}

/* Every sampling time: y [m], the control signal u_previous [V] that acted since the last one, and
 * position x [m] and velocity v [m/s] by the measurement, which become what is to be fed back. */
void filter_interrupt(amb_real y, amb_real u_previous, amb_real *x, amb_real *v)
{
  seen mine;
  if (start_anew) {
    zittau_axial_init(&filter);
    start_anew = false;
  }
  mine.status = latest.status | zittau_axial_step(&filter, y, u_previous, &mine.now);
  zittau_axial_deviations(&filter, mine.std); /* where somebody wants them: roots take time */
  latest = mine;
  written++;
  go_over(&mine.now, x, v);
}

/* ---- In any other task ---- */

/* A copy that belongs together: taken again where the interrupt has come in between. */
void look(seen *copy)
{
  unsigned int before;
  do {
    before = written;
    *copy = latest;
  } while (before != written);
}

/* The state is the interrupt's: others ask it to start anew, and do not call init themselves. */
void ask_to_start_anew(void)
{
  start_anew = true;
}
