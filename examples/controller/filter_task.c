/* What a controller's firmware does with an exported filter:
 * ambkit export c zittau_axial --filter expert.json --out out/ */
#include "zittau_axial.h"

#define LONGEST_OUTAGE 20U /* samples that may be missing in a row */

static zittau_axial_state filter; /* one for each bearing */
static amb_real u_previous;       /* control signal that acts until the next sample [V] */
static unsigned int missing;

void filter_start(void)
{
  zittau_axial_init(&filter);
  u_previous = AMB_C(0.0);
  missing = 0U;
}

/* Every sampling time, with the measured position y [m]. Returns the control signal [V]. */
amb_real filter_sample(amb_real y, amb_real (*controller)(const zittau_axial_estimates *now),
                       void (*land_the_rotor)(void))
{
  zittau_axial_estimates now;
  const amb_status status = zittau_axial_step(&filter, y, u_previous, &now);
  /* now.feed_back is false while the estimate is not settled: the controller then takes y. */
  missing = ((status & (AMB_MISSING | AMB_FROZEN)) != 0U) ? (missing + 1U) : 0U;
  if (missing > LONGEST_OUTAGE) {
    land_the_rotor();
  }
  u_previous = controller(&now);
  return u_previous;
}
