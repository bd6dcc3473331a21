/* What a rotor between its stops can do, and how an estimate that knows less than that, or says
 * more, is brought back. Nothing here happens in a run without faults.
 *
 * Caps, for each state the most that it can be. Of the paper's: x_max; a tenth of it in a sample,
 * 0.1 x_max / T; the force that takes the rotor there within one, 0.1 m x_max / T^2; and what the
 * sensor shows, 3 |K_sen| x_max.
 *
 * - Held. Without measurements the unstable plant runs away, until nothing is known but that the
 *   rotor is between the stops. From then on just that is said, sample by sample: positions
 *   anywhere, velocities open as far as they had become with them, sensors at the rotor to a tenth,
 *   and none of it correlated with anything else, as the stops have bent whatever path was
 *   predicted. The sensors are, so the first measurement tells the position. Of several positions
 *   those are held that are not known any more, with the velocities that move them and what sensors
 *   show of them; the others, and loads and currents, are as they were.
 * - Started afresh, from a measurement: so many outliers in a row that it is the estimate which is
 *   wrong. It is known ten times worse than was believed, so what was far too sure is believed
 *   less and less at each attempt. With one sensor the rotor is then where that shows it, at rest
 *   and without a load. With several that concerns what is correlated with what the sensor shows,
 *   and is told first once more by those others that go along with the estimate.
 * - Opened: a mean beyond AMB_ASTRAY caps, or a variance that is not finite. All that is left is
 *   what the caps and the sensors say.
 */
#ifndef AMBKIT_ENVELOPE_H
#define AMBKIT_ENVELOPE_H

#include "ambkit/kalman.h"

AMB_EXTERN_C_BEGIN

/* Caps, beyond which a mean is none. */
#define AMB_ASTRAY AMB_C(10.0)

/* Whether all of the mean is within so many caps; false for what is not a number. */
bool amb_envelope_within(const amb_kalman *kf, amb_real caps, const amb_real mean[AMB_STATES]);

/* Whether an estimate is one at all: the mean within so many caps, and each entry of the covariance
 * within what is left to a rotor, AMB_BOUNDLESS caps of both its states. False for what is not a
 * number. No run comes near it; but from such a state on a step has bounds for all that it
 * computes, whatever its input. */
bool amb_envelope_bounds(const amb_kalman *kf, amb_real caps, const amb_real mean[AMB_STATES],
                         const amb_real cov[AMB_TRIANGLE]);

/* Hold a mean to the caps. True where it was beyond. */
bool amb_envelope_clamp(const amb_kalman *kf, amb_real mean[AMB_STATES]);

/* The mean of a rotor at rest, between the stops, where sensor r shows y [m]. What follows from the
 * controls stays; with several sensors all that this one does not see, too, within the caps. */
void amb_envelope_place(const amb_kalman *kf, int r, amb_real y, amb_real mean[AMB_STATES]);

/* The open covariance. */
void amb_envelope_open(const amb_kalman *kf, amb_real P[AMB_TRIANGLE]);

/* What would be held of a state of covariance P. Returns whether there are positions that would not
 * be. */
bool amb_envelope_lost(const amb_kalman *kf, const amb_real P[AMB_TRIANGLE], bool lost[AMB_STATES]);

/* Hold a state, or open it. Returns AMB_HELD, with AMB_RESTARTED where it was opened. */
amb_status amb_envelope_hold(const amb_kalman *kf, amb_kalman_state *state);

/* Start afresh from the measurement y [m] of sensor r; what was counted, and the last control
 * signals, stay. */
void amb_envelope_restart(const amb_kalman *kf, amb_kalman_state *state, int r, amb_real y);

AMB_EXTERN_C_END

#endif
