/* Optional parts of a plant beside magnets, rotor, sensor lags and hard stops; each is off at 0. */
#ifndef AMBKIT_SIM_PARTS_H
#define AMBKIT_SIM_PARTS_H

#include "ambkit/real.h"

#define AMB_DELAY_MOST 16 /* samples */
#define AMB_RUNOUT_MOST 5 /* orders */
#define AMB_BEHIND_MOST 5 /* states */

typedef struct amb_parts {
  /* Amplifier. Within its voltage the current follows the demanded one by di/dt = corner (i* - i),
   * the loop of a current controller that compensates coil and back-EMF. The voltage of a coil is L
   * di/dt + R i + (L i/(s0 - x)) v with L = 2 k/(s0 - x), as for an ideal magnet. */
  amb_real corner;  /* [rad/s]; 0: the current follows immediately */
  amb_real voltage; /* maximum magnitude for a coil [V]; 0: no limit, and the following members are
                       unused */
  amb_real R;       /* resistance of a coil [ohm] */
  amb_real k;       /* magnet constant [N m^2/A^2] */
  amb_real s0;      /* nominal air gap [m] */
  amb_real i0;      /* bias current [A] */
  bool pair;        /* two coils, of i0 + iu and i0 - iu; else one */

  /* Linear states e between the force F of a magnet and the rotor: e' = A e + b F; the force c e +
   * d F acts. */
  int behind;                                           /* number of states; 0: F acts directly */
  int behind_at[AMB_BEHIND_MOST];                       /* their indices in the plant's state */
  amb_real behind_A[AMB_BEHIND_MOST * AMB_BEHIND_MOST]; /* row by row of `behind` [1/s] */
  amb_real behind_b[AMB_BEHIND_MOST];
  amb_real behind_c[AMB_BEHIND_MOST];
  amb_real behind_d;
  amb_real behind_rest[AMB_BEHIND_MOST]; /* e in equilibrium, for 1 N */

  /* Sensor. It measures x and the runout, multiplied by 1 + quadratic x + cubic x^2, with a lag;
   * noise is added, then quantisation. */
  amb_real quadratic; /* [1/m] */
  amb_real cubic;     /* [1/m^2] */
  amb_real step;      /* quantisation [m]; 0: none */
  amb_real rise;      /* relative increase of the noise, see amb_noise_share [1/m] */
  int orders;         /* number of runout orders, 0 to AMB_RUNOUT_MOST */
  amb_real speed;     /* speed of rotation of an axis; orders * speed * T < pi [rad/s] */
  amb_real runout_cosine[AMB_RUNOUT_MOST]; /* order n is cosine cos(n phi) ... [m] */
  amb_real runout_sine[AMB_RUNOUT_MOST];   /* ... + sine sin(n phi) [m] */

  /* Contact with a stop at the penetration d: force stiffness d^1.5 (1 + 3/2 damping d'), never
   * negative (Hunt and Crossley 1975). A slow impact of velocity v keeps 1 - damping v of its
   * speed. */
  amb_real stiffness; /* [N/m^1.5]; 0: a hard stop, without bouncing */
  amb_real damping;   /* [s/m] */
  amb_real friction;  /* of a ring about two axes, Coulomb's coefficient [1] */
  amb_real radius;    /* radius of the rotor's surface there [m] */
} amb_parts;

/* Rate of the control current of the coil towards +x [A/s], within its voltage, for this factor of
 * its magnet constant. For the other coil it is -amb_parts_rate of its negative current and demand,
 * at -x and -v. */
amb_real amb_parts_rate(const amb_parts *parts, amb_real scale, amb_real i, amb_real demanded,
                        amb_real x, amb_real v);

/* Its voltage [V] at this rate. */
amb_real amb_parts_voltage(const amb_parts *parts, amb_real scale, amb_real i, amb_real rate,
                           amb_real x, amb_real v);

/* The part of a magnet's force [N] that acts on the rotor, for the states X of the plant ... */
amb_real amb_parts_behind(const amb_parts *parts, const amb_real X[], amb_real force);

/* ... and the rates of the states between. */
void amb_parts_follow(const amb_parts *parts, const amb_real X[], amb_real force, amb_real d[]);

/* Cosine and sine of an angle, |angle| < pi, by the series of an eighth of it. */
void amb_parts_turn(amb_real angle, amb_real *cosine, amb_real *sine);

/* Steady-state output of the sensor, times its gain [m], at the position x [m] and the cosine and
 * sine of the angle of rotation. */
amb_real amb_parts_shown(const amb_parts *parts, amb_real K_sen, amb_real x, amb_real cosine,
                         amb_real sine);

/* Output of a sensor with lagged position x_m and this noise, a multiple of its step [m]. */
amb_real amb_parts_reading(const amb_parts *parts, amb_real x_m, amb_real noise);

/* Slip [m/s] below which friction is proportional to it. */
#define AMB_STICKS AMB_C(1e-3)

/* Force of a stop [N] at this penetration [m] and penetration velocity [m/s]. */
amb_real amb_parts_push(const amb_parts *parts, amb_real depth, amb_real inward);

#endif
