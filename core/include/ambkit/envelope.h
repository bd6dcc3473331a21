/* Physical limits of a rotor between its stops, and the recovery of an estimate that is lost or
 * outside them. Nothing here acts in a run without faults.
 *
 * Caps: the maximum of each state. For the paper's axis: x_max; a tenth of it per sample, 0.1 x_max
 * / T; the force that moves the rotor that far within one, 0.1 m x_max / T^2; and the reading, 3
 * |K_sen| x_max.
 *
 * - Held. Without measurements the estimate of the unstable plant diverges, until nothing is known
 *   but that the rotor is between the stops. From then on the estimate states just that, sample by
 *   sample: positions anywhere, velocities with the variance reached by then, readings at the rotor
 *   to a tenth, and no correlation with other states, because contact has changed any predicted
 *   path. Readings are correlated with positions, so the first measurement determines the position.
 *   Of several positions those that are lost are held, with their velocities and readings; the
 *   others, disturbance forces and currents are unchanged.
 * - Restarted, from a measurement: after so many consecutive outliers the estimate must be wrong.
 *   Its standard deviations are multiplied by ten, so an overconfident estimate loses weight with
 *   each attempt. With one sensor the rotor is placed at the reading, at rest and without
 *   disturbance force. With several, this applies to the states correlated with that reading, and
 *   the other sensors that agree with the estimate are taken into account again first.
 * - Opened: a mean beyond AMB_ASTRAY caps, or a variance that is not finite. Only caps and sensors
 *   remain.
 */
#ifndef AMBKIT_ENVELOPE_H
#define AMBKIT_ENVELOPE_H

#include "ambkit/kalman.h"

AMB_EXTERN_C_BEGIN

/* Caps beyond which a mean is invalid. */
#define AMB_ASTRAY AMB_C(10.0)

/* Whether the complete mean is within so many caps; false if it is not finite. */
bool amb_envelope_within(const amb_kalman *kf, amb_real caps, const amb_real mean[AMB_STATES]);

/* Whether an estimate is valid: the mean within so many caps, and each entry of the covariance
 * within AMB_BOUNDLESS caps of both its states. False if it is not finite. No run comes close; but
 * from a valid state, everything that a step computes is bounded, for any input. */
bool amb_envelope_bounds(const amb_kalman *kf, amb_real caps, const amb_real mean[AMB_STATES],
                         const amb_real cov[AMB_TRIANGLE]);

/* Limit a mean to the caps. True if it was beyond. */
bool amb_envelope_clamp(const amb_kalman *kf, amb_real mean[AMB_STATES]);

/* The mean of a rotor at rest, between the stops, with the reading y [m] of sensor r. States that
 * follow from the controls are unchanged; with several sensors also all that this one does not
 * measure, within the caps. */
void amb_envelope_place(const amb_kalman *kf, int r, amb_real y, amb_real mean[AMB_STATES]);

/* The open covariance. */
void amb_envelope_open(const amb_kalman *kf, amb_real P[AMB_TRIANGLE]);

/* What would be held of a state with covariance P. Returns whether any position would not. */
bool amb_envelope_lost(const amb_kalman *kf, const amb_real P[AMB_TRIANGLE], bool lost[AMB_STATES]);

/* Hold a state, or open it. Returns AMB_HELD, with AMB_RESTARTED if it was opened. */
amb_status amb_envelope_hold(const amb_kalman *kf, amb_kalman_state *state);

/* Restart from the measurement y [m] of sensor r; counters and the last control signals are
 * unchanged. */
void amb_envelope_restart(const amb_kalman *kf, amb_kalman_state *state, int r, amb_real y);

AMB_EXTERN_C_END

#endif
