/* What the rotor and its filter share. */
#ifndef WORKBENCH_ROTOR_H
#define WORKBENCH_ROTOR_H

#include "ambkit/rebuild.h"
#include "noise_drawn.h"

#define EXPORT(name) __attribute__((export_name(#name)))
#define MOST 10001 /* samples of a flight */
#define WIDE 8     /* axes, sensors and positions at most */

/* The filter with the model of the parameters that the page has written, at its start; it takes the
 * magnets for `k` times as strong as they are. NULL: these parameters make none. */
const amb_estimator *rotor_filter(bool extended, double k, const amb_law magnets[]);
void *rotor_filter_state(void);
amb_kalman_history rotor_filter_history(void);

#endif
