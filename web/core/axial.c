/* Constants of the paper's axis by the formulas of its straight-line build, which round differently
 * from the general matrix exponential. This is the only file of the page that is compiled without
 * loops; none of its model structs leaves it. */
#undef AMB_MODEL_LOOPS
#include "ambkit/model.h"

void axial_constants(const double p[], double to[]);

/* From T, mass, gain and lag, in the order of PAPER_CONSTANTS (src/ambkit/models/machine_parts.py).
 * */
void axial_constants(const double p[], double to[])
{
  amb_model m;
  amb_model_init(&m, p[0], p[1], p[2], p[3]);
  const double all[] = {m.T,   m.T_2, m.T_m, m.T2_2m, m.a_sen, m.b_sen, m.c_sen, m.d_sen, m.K_sen,
                        m.N00, m.N01, m.N02, m.N03,   m.N11,   m.N12,   m.N13,   m.N23,   m.N33};
  for (int k = 0; k < (int)(sizeof(all) / sizeof(all[0])); k++)
    to[k] = all[k];
}
