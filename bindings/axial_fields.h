/* Each constant, for whoever asks for all. Written by `python -m models`; do not edit. */
#ifndef AMBKIT_AXIAL_FIELDS_H
#define AMBKIT_AXIAL_FIELDS_H

#define AMB_MODEL_FIELDS(FIELD)                                                                    \
  FIELD(T);                                                                                        \
  FIELD(T_2);                                                                                      \
  FIELD(T_m);                                                                                      \
  FIELD(T2_2m);                                                                                    \
  FIELD(a_sen);                                                                                    \
  FIELD(b_sen);                                                                                    \
  FIELD(c_sen);                                                                                    \
  FIELD(d_sen);                                                                                    \
  FIELD(K_sen);                                                                                    \
  FIELD(N00);                                                                                      \
  FIELD(N01);                                                                                      \
  FIELD(N02);                                                                                      \
  FIELD(N03);                                                                                      \
  FIELD(N11);                                                                                      \
  FIELD(N12);                                                                                      \
  FIELD(N13);                                                                                      \
  FIELD(N23);                                                                                      \
  FIELD(N33)

#endif
