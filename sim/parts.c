#include "parts.h"
#include "ambkit/root.h"
#include <stdint.h>

amb_real amb_parts_voltage(const amb_parts *parts, amb_real scale, amb_real i, amb_real rate,
                           amb_real x, amb_real v)
{
  const amb_real gap = parts->s0 - x, L = 2 * (scale * parts->k) / gap,
                 coil_current = parts->i0 + i;
  return L * rate + (parts->R + L * v / gap) * coil_current;
}

amb_real amb_parts_rate(const amb_parts *parts, amb_real scale, amb_real i, amb_real demanded,
                        amb_real x, amb_real v)
{
  const amb_real rate = parts->corner * (demanded - i);
  if (!(parts->voltage > 0))
    return rate;
  const amb_real u = amb_parts_voltage(parts, scale, i, rate, x, v);
  const amb_real over = u - amb_clamp(u, -parts->voltage, parts->voltage);
  return rate - over * (parts->s0 - x) / (2 * (scale * parts->k));
}

amb_real amb_parts_behind(const amb_parts *parts, const amb_real X[], amb_real force)
{
  if (parts->behind == 0)
    return force;
  amb_real sum = parts->behind_d * force;
  for (int k = 0; k < parts->behind; k++)
    sum += parts->behind_c[k] * X[parts->behind_at[k]];
  return sum;
}

void amb_parts_follow(const amb_parts *parts, const amb_real X[], amb_real force, amb_real d[])
{
  for (int k = 0; k < parts->behind; k++) {
    amb_real sum = parts->behind_b[k] * force;
    for (int j = 0; j < parts->behind; j++)
      sum += parts->behind_A[k * parts->behind + j] * X[parts->behind_at[j]];
    d[parts->behind_at[k]] = sum;
  }
}

void amb_parts_turn(amb_real angle, amb_real *cosine, amb_real *sine)
{
  const amb_real a = angle / 8, q = a * a;
  amb_real c = 1, s = 1;
  for (int n = 12; n > 0; n -= 2) {
    c = 1 - c * q / (amb_real)(n * (n - 1));
    s = 1 - s * q / (amb_real)((n + 1) * n);
  }
  s *= a;
  for (int n = 0; n < 3; n++) {
    const amb_real twice = 2 * s * c;
    c = 1 - 2 * s * s;
    s = twice;
  }
  *cosine = c;
  *sine = s;
}

amb_real amb_parts_shown(const amb_parts *parts, amb_real K_sen, amb_real x, amb_real cosine,
                         amb_real sine)
{
  amb_real sum = 0, c = 1, s = 0;
  for (int n = 0; n < parts->orders; n++) {
    const amb_real next = c * cosine - s * sine;
    s = s * cosine + c * sine;
    c = next;
    sum += parts->runout_cosine[n] * c + parts->runout_sine[n] * s;
  }
  const amb_real seen = x + sum;
  const amb_real bent = (parts->quadratic + parts->cubic * seen) * seen;
  return K_sen * (seen + seen * bent);
}

amb_real amb_parts_reading(const amb_parts *parts, amb_real x_m, amb_real noise)
{
  const amb_real y = x_m + amb_noise_share(parts->rise, x_m) * noise;
  if (!(parts->step > 0))
    return y;
  const amb_real steps = y / parts->step;
  if (!(amb_magnitude(steps) < AMB_C(1e15))) /* no digits after the point, or not finite */
    return y;
  return parts->step * (amb_real)(int64_t)(steps < 0 ? steps - AMB_C(0.5) : steps + AMB_C(0.5));
}

amb_real amb_parts_push(const amb_parts *parts, amb_real depth, amb_real inward)
{
  if (!(parts->stiffness > 0) || !(depth > 0))
    return 0;
  const amb_real give = 1 + AMB_C(1.5) * parts->damping * inward;
  return parts->stiffness * depth * amb_root(depth) * (give > 0 ? give : 0);
}
