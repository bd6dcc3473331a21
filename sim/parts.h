/* What a plant may have beside magnets, rotor, lags and hard stops; each part is off at 0. */
#ifndef AMBKIT_SIM_PARTS_H
#define AMBKIT_SIM_PARTS_H

#include "ambkit/real.h"

#define AMB_DELAY_MOST 16 /* samples */
#define AMB_RUNOUT_MOST 5 /* orders */
#define AMB_BEHIND_MOST 5 /* states */

typedef struct amb_parts {
  /* Amplifier: within its voltage the current follows the demanded one by di/dt = corner (i* - i),
   * for a current controller that knows coil and back-EMF; the voltage of a coil is
   * L di/dt + R i + (L i/(s0 - x)) v with L = 2 k/(s0 - x), that of an ideal magnet. */
  amb_real corner;  /* [rad/s]; 0: the current follows at once */
  amb_real voltage; /* of a coil at most, either way [V]; 0: no limit, and what follows is idle */
  amb_real R;       /* resistance of a coil [ohm] */
  amb_real k;       /* magnet constant [N m^2/A^2] */
  amb_real s0;      /* nominal air gap [m] */
  amb_real i0;      /* bias current [A] */
  bool pair;        /* two coils, of i0 + iu and i0 - iu; else one */

  /* Linear states e between a magnet's force F and the rotor: e' = A e + b F; c e + d F acts. */
  int behind;                                           /* how many; 0: F acts at once */
  int behind_at[AMB_BEHIND_MOST];                       /* where they are among the plant's */
  amb_real behind_A[AMB_BEHIND_MOST * AMB_BEHIND_MOST]; /* row by row of `behind` [1/s] */
  amb_real behind_b[AMB_BEHIND_MOST];
  amb_real behind_c[AMB_BEHIND_MOST];
  amb_real behind_d;
  amb_real behind_rest[AMB_BEHIND_MOST]; /* e at rest, for 1 N */

  /* Sensor: it sees x and the runout, bent by 1 + quadratic x + cubic x^2, and lags; after the
   * noise it is rounded. */
  amb_real quadratic; /* [1/m] */
  amb_real cubic;     /* [1/m^2] */
  amb_real step;      /* of the rounding [m]; 0: none */
  amb_real rise;      /* of the noise, see amb_noise_share [1/m] */
  int orders;         /* of the speed, 0 to AMB_RUNOUT_MOST */
  amb_real speed;     /* of an axis's rotation; orders * speed * T < pi [rad/s] */
  amb_real runout_cosine[AMB_RUNOUT_MOST]; /* order n is cosine cos(n phi) ... [m] */
  amb_real runout_sine[AMB_RUNOUT_MOST];   /* ... + sine sin(n phi) [m] */

  /* Contact with a stop in the depth d: stiffness d^1.5 (1 + 3/2 damping d'), never a pull (Hunt
   * and Crossley 1975). A slow impact of v keeps 1 - damping v of its speed. */
  amb_real stiffness; /* [N/m^1.5]; 0: a hard stop, at which the rotor stays */
  amb_real damping;   /* [s/m] */
  amb_real friction;  /* of a ring about two axes, Coulomb's [1] */
  amb_real radius;    /* of the rotor's surface in it [m] */
} amb_parts;

/* Rate of the control current of the coil towards +x [A/s], within its voltage, at this multiple of
 * its magnet constant; that of the other one is -amb_parts_rate of its negative current and demand,
 * at -x and -v. */
amb_real amb_parts_rate(const amb_parts *parts, amb_real scale, amb_real i, amb_real demanded,
                        amb_real x, amb_real v);

/* And its voltage [V] at this rate. */
amb_real amb_parts_voltage(const amb_parts *parts, amb_real scale, amb_real i, amb_real rate,
                           amb_real x, amb_real v);

/* What acts on the rotor of a magnet's force [N], with the states X of the plant ... */
amb_real amb_parts_behind(const amb_parts *parts, const amb_real X[], amb_real force);

/* ... and the rates of those between. */
void amb_parts_follow(const amb_parts *parts, const amb_real X[], amb_real force, amb_real d[]);

/* Cosine and sine of an angle, |angle| < pi, by the series of an eighth of it. */
void amb_parts_turn(amb_real angle, amb_real *cosine, amb_real *sine);

/* What the sensor settles at, times its gain [m], where it looks at x [m] and these are cosine and
 * sine of the angle of rotation. */
amb_real amb_parts_shown(const amb_parts *parts, amb_real K_sen, amb_real x, amb_real cosine,
                         amb_real sine);

/* What a sensor with x_m behind its lag and this noise shows, a multiple of its step [m]. */
amb_real amb_parts_reading(const amb_parts *parts, amb_real x_m, amb_real noise);

/* Slip [m/s] up to which friction is in proportion to it. */
#define AMB_STICKS AMB_C(1e-3)

/* What a stop pushes back with [N], so deep in it [m] and going deeper with this velocity [m/s]. */
amb_real amb_parts_push(const amb_parts *parts, amb_real depth, amb_real inward);

#endif
