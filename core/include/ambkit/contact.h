/* Extended Kalman filter of a rotor that may touch its touch-down bearings: `own` is an
 * amb_contact, the state an amb_contact_state.
 *
 * At the penetration d = |s| - clearance, a ring about two axes, or a stop along one, has the
 * normal force
 *
 *   N = K d^1.5 (1 + 3/2 damping d'),  N >= 0    (Hunt & Crossley 1975)
 *
 * Each prediction decides between two hypotheses: the rotor is free, or it is in contact, if its
 * mean displacement s over the sample is beyond the clearance.
 *
 * In contact N is held over the sample, as the magnet forces are, so that the model stays exact
 * between samples. A force that is held changes the mean displacement by its compliance,
 * T^2 / (6 mass), and the mean velocity by its mobility, T / (2 mass), where `mass` is the
 * effective mass at the contact. d and d' contain the response to the magnet and disturbance
 * forces. The response to N itself is solved for implicitly, by one step of Newton's method from
 * N_0, the force without it. With the tangents k by d and c by d', and the rows h and h' of
 * displacement and velocity by the states:
 *
 *   implicit = 1 / (1 + k compliance + c mobility)
 *   N = implicit N_0,  w = implicit (k h + c h'),  w the gradient of N by the states
 *
 * N is curved within the standard deviation of d. Its mean and variance therefore have
 * second-order terms (Gaussian second-order filter, Jazwinski 1970, 9.3). With E, the elastic part
 * of N, and at most 6, which is reached at a standard deviation of four times d:
 *
 *   bend = N'' var(d) / (2 N) = w'Pw / (6 E^2),   N <- (1 + bend) N
 *
 * With u, the response of the states to N:
 *
 *   A <- A - u w',   P+ = A P A' + growth + (2 bend^2 + scatter^2) N^2 u u'
 *
 * Along a ring, friction mu N opposes the slip of the rotor's surface, and is at most the force
 * that stops the slip within a sample; u is the response to both forces. A rotor that whirls takes
 * the normal round by the angle `turn` within a sample: the depth increases by |s| turn^2 / 24, the
 * mean N decreases by the same share, and across it there is a lateness of N turn / 3 (see below).
 * The direction of both forces follows the displacement across the normal, and friction that stops
 * the slip follows the velocity there. Both are a second entry of A and P+, of the variance
 * scatter^2 (turn^2 + mu^2) N^2, without mu^2 while it slides. Contacts of one rotor change the
 * motion at each other by `coupling`; each is computed with the forces of the others.
 *
 * A sample resolves stiffnesses up to 3 mass / T^2: a steeper force continues along its tangent.
 * Damping is limited to mass / T.
 *
 * Where a contact lasts fewer samples than a few, the motion along the normal is integrated in
 * AMB_CONTACT_PARTS of a sample, in each as above. It gives the mean N of the force over the sample
 * and its lateness, the mean of 4 N (t / T - 1/2), to which the states respond by `later`. Both
 * come from three points instead of tangents. Displacement and velocity at the start of the sample
 * are there (-sqrt 2, 0) and (sqrt 1/2, +-sqrt 3/2) standard deviations towards the stop, each with
 * weight 1/3: the mean and covariance of the estimate, with the skewness of a rotor that bounces,
 * whose distribution has its tail away from the stop. The slopes of the plane through the points
 * replace w (statistical linear regression, Lefebvre et al. 2002). Contact is flagged if two of the
 * points touch.
 *
 * While the magnets have no current (amb_contact_deenergise), their forces and stiffnesses are 0.
 */
#ifndef AMBKIT_CONTACT_H
#define AMBKIT_CONTACT_H

#include "ambkit/estimator.h"

AMB_EXTERN_C_BEGIN

#define AMB_CONTACT_PARTS 8 /* of a sample, where contacts are short */

typedef struct amb_contact {
  int rings;                         /* 0 to AMB_FORCES */
  int seen;                          /* number of first states with entries in h and h', > 0 */
  unsigned short first[AMB_FORCES];  /* first axis of a ring ... */
  unsigned short second[AMB_FORCES]; /* ... and second; equal to the first: a stop along it */
  amb_real clearance[AMB_FORCES];    /* [m], > 0 */
  amb_real stiffness[AMB_FORCES];    /* K [N/m^1.5], > 0 */
  amb_real damping[AMB_FORCES];      /* [s/m], >= 0 */
  amb_real friction[AMB_FORCES];     /* mu of a ring about two axes [1], >= 0 */
  amb_real surface[AMB_FORCES];      /* velocity of the rotor's surface by its rotation [m/s] */
  amb_real compliance[AMB_FORCES];   /* T^2 / (6 mass) [m/N], > 0 */
  amb_real mobility[AMB_FORCES];     /* T / (2 mass) [m/s/N], > 0 */
  amb_real displacement[AMB_FORCES][AMB_STATES]; /* h of each axis: mean over the sample ... */
  amb_real velocity[AMB_FORCES][AMB_STATES];     /* ... and h', its rate, by the states */
  amb_real later[AMB_FORCES][AMB_STATES];    /* response to a force of -1 N in the first half of a
                                                sample and 1 N in the second */
  amb_real coupling[AMB_FORCES][AMB_FORCES]; /* motion along an axis by the force along another,
                                                relative to the mobility of its ring [1] */
  bool brief;                                /* contacts last fewer samples than a few */
  amb_real scatter_squared;  /* variance of the contact force relative to N^2 [1], >= 0 */
  amb_real bias[AMB_FORCES]; /* bias forces of the magnets, part of f_0 in the settings [N] */
} amb_contact;

typedef struct amb_contact_state {
  amb_kalman_state base;
  bool deenergised; /* in the next prediction the magnets have no current */
} amb_contact_state;

/* Contact forces N along the axes [N] over the sample that begins at a mean of the states, under
 * control currents iu [A], or without magnet forces if `deenergised`; 0 if the rotor is free.
 * F: the other forces, where `scale` multiplies those of the magnets [N]. Returns AMB_CONTACT or
 * AMB_OK. */
amb_status amb_contact_forces(const amb_estimator *self, const amb_real mean[AMB_STATES],
                              const amb_real iu[AMB_CONTROLS], amb_real scale, bool deenergised,
                              amb_real F[AMB_FORCES], amb_real N[AMB_FORCES]);

/* Before a prediction: the magnets carry no current over its sample, not even the bias. */
void amb_contact_deenergise(void *state);

extern const amb_estimator_methods amb_contact_methods;

AMB_EXTERN_C_END

#endif
