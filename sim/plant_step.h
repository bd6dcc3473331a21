/* The plant without parts, one step of Runge-Kutta. No include guard: the text is compiled for
 * numbers (plant.c) and for lanes (lanes_many.c), who say what amb_real, amb_puller and amb_pull
 * are.
 */

/* What a step of the length h takes from plant and sampling time. */
typedef struct amb_stride {
  amb_real h, half, sixth, per_mass, per_lag, K, travel;
} amb_stride;

/* Position [m], velocity [m/s] and lagged position, times sensor gain [m]. */
typedef struct amb_motion {
  amb_real x, v, x_m;
} amb_motion;

/* A stage of Runge-Kutta may look beyond a stop; magnet and sensor do not find the rotor there. */
AMB_INLINE amb_real amb_reachable(const amb_stride *of, amb_real x)
{
  return amb_clamp(x, -of->travel, of->travel);
}

/* One step with control current iu and the constant acceleration g [m/s^2].
 *
 * x'' = F(x)/m + g does not ask for the velocity. So the classical method's stages of v are
 * eliminated (Nystroem 1925), and g's part is the parabola that it is: the same method with a
 * shorter chain of operations that wait for one another, and that is what its time goes into. */
AMB_INLINE void amb_runge_kutta(const amb_stride *of, const amb_puller *magnet, amb_motion *s,
                                amb_real iu, amb_real g)
{
  const amb_real h = of->h, half = of->half, sixth = of->sixth;
  const amb_real per_mass = of->per_mass, per_lag = of->per_lag, K = of->K;
  const amb_real x = s->x, v = s->v, x_m = s->x_m;

  const amb_real coasting = x + h * v + h * half * g; /* where it gets without the magnet */
  const amb_real halfway = x + half * v, x2 = amb_reachable(of, halfway);
  const amb_real F1 = amb_pull(magnet, iu, x), F2 = amb_pull(magnet, iu, x2);
  const amb_real x3 = amb_reachable(of, halfway + half * half * g + half * half * per_mass * F1);
  const amb_real x4 = amb_reachable(of, coasting + h * half * per_mass * F2);
  const amb_real F3 = amb_pull(magnet, iu, x3), F4 = amb_pull(magnet, iu, x4);
  s->x = coasting + h * sixth * per_mass * (F1 + F2 + F3);
  s->v = v + h * g + sixth * per_mass * (F1 + 2 * (F2 + F3) + F4);

  const amb_real d1 = (K * x - x_m) * per_lag;
  const amb_real d2 = (K * x2 - (x_m + half * d1)) * per_lag;
  const amb_real d3 = (K * x3 - (x_m + half * d2)) * per_lag;
  const amb_real d4 = (K * x4 - (x_m + h * d3)) * per_lag;
  s->x_m = x_m + sixth * (d1 + 2 * (d2 + d3) + d4);
}
