/* Whether k can currently be distinguished from a disturbance force, for estimators of the magnets'
 * scale theta = k / nominal k.
 *
 * In equilibrium it cannot: only the sum of both forces is observed. An unprotected estimator
 * drifts then: unmodelled noise colours the innovations, and theta changes until they are whiter
 * (Ljung 1979). Theta is therefore learned only if all of the following hold:
 *
 * - The measurements are informative: the sum of s_y^2 / S over the sensors, averaged over a
 *   window, is at least `least`.
 * - The magnet forces vary more than the disturbances: the variances of all disturbance forces over
 *   five windows are below a quarter of those of their slopes, which is the effect of an error of
 *   theta of one half. A controller answers a disturbance with an equal force, which would look
 *   like a change of k.
 * - The rotor is away from all stops, which exert forces too; contact restarts the window.
 * - All has settled, since the start, and since the last flag or restart of a sensor: each such
 *   sample costs a window.
 * - The control signal has not been beyond its limit for long. The current is then uncertain, and a
 *   magnet that does not respond looks weak; in equilibrium nothing would correct that later. Up to
 *   one window of such samples more than good ones is tolerated, as in a step of the position;
 *   beyond it, what was learned since the first of them is undone.
 *
 * The slope s is the sensitivity of the state estimate to theta. It is predicted and corrected as
 * the states are.
 *
 * An error of theta makes the estimated disturbance forces follow their slopes. The regression
 * `offset` of one on the other estimates that error, whatever the bandwidth of the filter.
 *
 * Theta is common to all magnets: a wrong number of turns, gap or temperature of one type of
 * magnet. A model without a disturbance force has no such ambiguity, and does not need this.
 */
#ifndef AMBKIT_EXCITATION_H
#define AMBKIT_EXCITATION_H

#include "ambkit/kalman.h"

AMB_EXTERN_C_BEGIN

/* Windows for the variances, and until the start is forgotten. */
#define AMB_LOAD_WINDOWS AMB_C(5.0)
#define AMB_SETTLED_WINDOWS AMB_C(15.0)
/* Variance of the disturbance estimate over that of its slope [1], beyond which theta is held. */
#define AMB_LOAD_SHARE AMB_C(0.25)
/* Time of saturation beyond which nothing is learned, and its maximum count [windows]. */
#define AMB_DOUBTFUL_WINDOWS AMB_C(1.0)
#define AMB_DOUBT_WINDOWS AMB_C(15.0)
/* Share of the way to the stops from which contact is possible [1]. */
#define AMB_NEAR_STOP AMB_C(0.95)

typedef struct amb_excitation_settings {
  amb_real fresh; /* weight of a new sample in the window's average [1], in (0, 1] */
  amb_real least; /* information of a sample from which theta is learned [1]; 0: always */
} amb_excitation_settings;

/* Mean and variance over the last samples. */
typedef struct amb_recent {
  amb_real mean;
  amb_real var;
} amb_recent;

typedef struct amb_excitation {
  amb_real slope[AMB_STATES];    /* s, of all states */
  amb_real sample_information;   /* information on theta by the sensors of this sample so far [1] */
  amb_real information;          /* information of a sample on theta, averaged over the window [1]
                                  */
  amb_recent load[AMB_STATES];   /* of the disturbance forces f_d [N] */
  amb_recent answer[AMB_STATES]; /* slope of f_d [N] */
  amb_real shared;               /* covariance of the two, over all f_d [N^2] */
  amb_real offset;               /* theta less the present one, if f_d rests [1] */
  amb_real balanced;             /* regression of the slopes on f_d: 1 / theta if magnets balance
                                  * f_d, other motion notwithstanding [1] */
  bool informative;              /* whatever f_d does, theta could be learned */
  amb_real age;   /* time since the start, less outages [windows], until all has settled */
  amb_real doubt; /* samples beyond the limit minus the others since, at least 0 [windows] */
} amb_excitation;

/* Start, at a mean of the states. */
void amb_excitation_reset(amb_excitation *e, const amb_real mean[AMB_STATES]);

/* Measurements or a control signal are missing, and would bias the next samples. */
void amb_excitation_miss(amb_excitation *e);

/* A control signal beyond its limit. True if that has just become too long: what was learned since
 * the doubt was 0 must be undone. */
bool amb_excitation_doubt(amb_excitation *e, const amb_excitation_settings *settings);

/* Time update; known: forces of the nominal magnets [N], k: stiffnesses of the estimated ones. */
void amb_excitation_predict(amb_excitation *e, const amb_model *model,
                            const amb_stiffness k[AMB_FORCES], const amb_real known[AMB_FORCES]);

/* After a measurement of sensor r, which corrected the states by with_y / S times the innovation.
 * */
void amb_excitation_update(amb_excitation *e, const amb_model *model, int r,
                           const amb_real with_y[AMB_STATES], amb_real S);

/* Resets slopes beyond AMB_BOUNDLESS caps, or not finite, to 0, and what they informed. */
void amb_excitation_hold(amb_excitation *e, const amb_kalman *kf);

/* After all measurements of a sample; mean: the corrected states. True if theta can be learned from
 * them. */
bool amb_excitation_learns(amb_excitation *e, const amb_excitation_settings *settings,
                           const amb_kalman *kf, const amb_real mean[AMB_STATES]);

AMB_EXTERN_C_END

#endif
