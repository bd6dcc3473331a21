/* Whether k can be told apart from a load now, for the estimators of the magnet's scale
 * theta = k / known k.
 *
 * At rest it cannot be: only the sum of both forces is seen. An estimator that is not held back
 * drifts there: what its noise model does not know colours the innovations, and theta is bent
 * until they are whiter (Ljung 1979). So theta is only to be learned where all of this holds:
 *
 * - Measurements tell much about it: the sum of s_y^2 / S over the sensors of a sample, averaged
 *   over a window, is `least` or more.
 * - The magnets move more than the loads: the variances of all disturbance forces over five windows
 *   together are below a quarter of those of their slopes, which is what theta wrong by half makes
 *   of them. A controller answers a load with as much force, and that would pass for a change of k.
 * - The rotor is away from all stops, which push too; there the window begins anew.
 * - All has settled, since the start, and since no sensor said anything or one began afresh: each
 *   such sample costs a window.
 * - The control signal has not been beyond its limit for long. What the amplifier then gives is a
 *   guess, and a magnet that does not answer passes for a weak one; at rest nothing would correct
 *   that later. A window of such samples beyond the good ones is let pass, for a step of the
 *   position may take it; with more, what was learned since the first of them is taken back.
 *
 * The slope s is that of the estimate of the states with theta: how they would be off, were
 * theta off by one. It moves as the states do and is corrected as they are.
 *
 * Theta is one scale for all magnets: a wrong turns count, gap or temperature of one kind of
 * magnet. A model without a disturbance force has nothing that k could be taken for, and no use for
 * this.
 */
#ifndef AMBKIT_EXCITATION_H
#define AMBKIT_EXCITATION_H

#include "ambkit/kalman.h"

AMB_EXTERN_C_BEGIN

/* Windows for the variances, and until they have forgotten the start. */
#define AMB_LOAD_WINDOWS AMB_C(5.0)
#define AMB_SETTLED_WINDOWS AMB_C(15.0)
/* Variance of the load estimate over that of its slope [1], beyond which theta is held. */
#define AMB_LOAD_SHARE AMB_C(0.25)
/* Of saturation, from which on nothing is learned, and what counts at most [windows]. */
#define AMB_DOUBTFUL_WINDOWS AMB_C(1.0)
#define AMB_DOUBT_WINDOWS AMB_C(15.0)
/* Of the way to the stops, from which on they may push [1]. */
#define AMB_NEAR_STOP AMB_C(0.95)

typedef struct amb_excitation_settings {
  amb_real fresh; /* share of a new sample in the window's average [1], in (0, 1] */
  amb_real least; /* information of a sample from which on theta is learned [1]; 0: always */
} amb_excitation_settings;

/* Mean and variance over the last samples. */
typedef struct amb_recent {
  amb_real mean;
  amb_real var;
} amb_recent;

typedef struct amb_excitation {
  amb_real slope[AMB_STATES];    /* s, of all states */
  amb_real told;                 /* of theta by the sensors of this sample so far [1] */
  amb_real information;          /* of a sample about theta, averaged over the window [1] */
  amb_recent load[AMB_STATES];   /* of the states that are loads: f_d [N] */
  amb_recent answer[AMB_STATES]; /* slope of f_d [N] */
  amb_real age;   /* since the start, less what was missing [windows], until all has settled */
  amb_real doubt; /* samples beyond the limit, less the others since, at least 0 [windows] */
} amb_excitation;

/* Start, at a mean of the states. */
void amb_excitation_reset(amb_excitation *e, const amb_real mean[AMB_STATES]);

/* Measurements or a control signal are missing: what is learned next would be of that. */
void amb_excitation_miss(amb_excitation *e);

/* A control signal beyond its limit. True where that has just become long: what was learned since
 * the doubt was 0 is to be taken back. */
bool amb_excitation_doubt(amb_excitation *e, const amb_excitation_settings *settings);

/* One sample on; known: forces of the known magnets [N], k: stiffnesses of the estimated ones. */
void amb_excitation_predict(amb_excitation *e, const amb_model *model,
                            const amb_stiffness k[AMB_FORCES], const amb_real known[AMB_FORCES]);

/* After a measurement of sensor r, which corrected the states by with_y / S times the innovation.
 */
void amb_excitation_update(amb_excitation *e, const amb_model *model, int r,
                           const amb_real with_y[AMB_STATES], amb_real S);

/* No slope of a state is beyond AMB_BOUNDLESS caps, or not a number: such a one becomes 0. */
void amb_excitation_hold(amb_excitation *e, const amb_kalman *kf);

/* After all measurements of a sample; mean: what the states are now. True where theta can be
 * learned from them. */
bool amb_excitation_learns(amb_excitation *e, const amb_excitation_settings *settings,
                           const amb_kalman *kf, const amb_real mean[AMB_STATES]);

AMB_EXTERN_C_END

#endif
