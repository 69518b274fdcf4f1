/* Neo-Hooke's law, W = mu/2 (tr C - 3 - 2 ln J) + lambda/2 (ln J)^2, by MFront's generic interface.  One state
   variable: the largest ln J so far. */
#include <math.h>

typedef struct {
  double *gradients, *forces, *density, *properties, *variables, *stored, *dissipated, *external;
} state;

typedef struct {
  char *message;
  double dt, *K, *rdt, *speed;
  state s0, s1;
} data;

static const int row[9] = {0, 1, 2, 0, 1, 0, 2, 1, 2}, column[9] = {0, 1, 2, 1, 0, 2, 0, 2, 1};

#ifdef RELEASE
const char *neo_hooke_tfel_version = RELEASE;
#endif

int neo_hooke(data *d) {
  double F[3][3], G[3][3], mu = d->s1.properties[0], lambda = d->s1.properties[1], J = 0.0;
  for (int m = 0; m < 9; ++m) F[row[m]][column[m]] = d->s1.gradients[m];
  for (int a = 0; a < 3; ++a)
    for (int b = 0; b < 3; ++b) {
      int c = (a + 1) % 3, e = (a + 2) % 3, f = (b + 1) % 3, g = (b + 2) % 3;
      G[a][b] = F[c][f] * F[e][g] - F[c][g] * F[e][f];
    }
  for (int b = 0; b < 3; ++b) J += F[0][b] * G[0][b];
  if (!(J > 0.0) || d->K[1] != 2.0) return -1;
  for (int a = 0; a < 3; ++a)
    for (int b = 0; b < 3; ++b) G[a][b] /= J;
  double growth = log(J), pressure = lambda * growth - mu;
  d->s1.variables[0] = fmax(d->s0.variables[0], growth);
  for (int m = 0; m < 9; ++m) d->s1.forces[m] = mu * F[row[m]][column[m]] + pressure * G[row[m]][column[m]];
  if (d->K[0] > 3.5)
    for (int m = 0; m < 9; ++m)
      for (int n = 0; n < 9; ++n) {
        int a = row[m], A = column[m], b = row[n], B = column[n];
        d->K[9 * m + n] = (m == n ? mu : 0.0) + lambda * G[a][A] * G[b][B] - pressure * G[a][B] * G[b][A];
      }
  return 1;
}
