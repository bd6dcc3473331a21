/* The plant where it has parts; plant.h says what each function does. */
#ifndef AMBKIT_SIM_PARTS_STEP_H
#define AMBKIT_SIM_PARTS_STEP_H

#include "plant.h"

bool amb_parts_advance(const amb_plant *plant, amb_plant_state *state, amb_real T, amb_real iu,
                       amb_real g);
void amb_parts_rates(const amb_plant *plant, const amb_plant_state *state, amb_real iu, amb_real g,
                     amb_plant_state *rates);
void amb_parts_settle(const amb_plant *plant, amb_plant_state *state, amb_real iu);

/* What acts while the control current iu [A] is demanded. */
amb_acting amb_parts_acting(const amb_plant *plant, const amb_plant_state *state, amb_real iu);

/* The demanded current that counts just after a sample at which iu is demanded [A]. */
amb_real amb_parts_next(const amb_parts *parts, const amb_plant_state *state, amb_real iu);

/* Rate of the control current of the coil towards +x [A/s], within its voltage; that of the other
 * one is -amb_parts_rate of its negative current and demand, at -x and -v. */
amb_real amb_parts_rate(const amb_parts *parts, amb_real i, amb_real demanded, amb_real x,
                        amb_real v);

/* Cosine and sine of an angle, |angle| < pi, by the series of an eighth of it. */
void amb_parts_turn(amb_real angle, amb_real *cosine, amb_real *sine);

/* What the sensor settles at, times its gain [m], where it looks at x [m] and these are cosine and
 * sine of the angle of rotation. */
amb_real amb_parts_shown(const amb_parts *parts, amb_real K_sen, amb_real x, amb_real cosine,
                         amb_real sine);

/* What a stop pushes back with [N], so deep in it [m] and going deeper with this velocity [m/s]. */
amb_real amb_parts_push(const amb_parts *parts, amb_real depth, amb_real inward);

#endif
