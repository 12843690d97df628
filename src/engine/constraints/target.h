#pragma once

#include <algorithm>

#include "engine/constraints/row.h"

namespace constraint_sim::engine {

// Targets of a row from its value C: J V = ζ − (β/h) C and variants, where `target` already is ζ.
// The rate that closes an error is kept apart, since it moves the bodies in this step alone.

/// Sets the correction of an equation: a share β of the error per step (Baumgarte).
inline void set_bias_rigid(Row& row, double beta, double h) { row.correction = -beta / h * row.C; }

/// Sets target and correction of a limit with C ≤ 0 (upper = 0) or C ≥ 0 (lower = 0). An open gap
/// may close within this step, but not more.
inline void set_bias_limit(Row& row, double beta, double h) {
  const bool open = row.upper == 0.0 ? row.C < 0.0 : row.C > 0.0;
  set_bias_rigid(row, beta, h);
  if (!open) return;
  row.target -= row.C / h;
  row.correction = 0.0;
}

/// Sets the bias of a spring of stiffness k [N/m] and damping c [N s/m] about C = 0 by implicit
/// Euler: the force −k (C + h Ċ) − c Ċ at the end of the step, stable at any stiffness. Catto,
/// "Soft constraints", GDC 2011. Not inlined, so that rows without a spring do not pay for it.
[[gnu::noinline]] inline void set_bias_soft(Row& row, double k, double c, double h) {
  row.softness = 1.0 / (h * (c + h * k));
  row.stiffness = k;
  row.target -= h * k * row.softness * row.C;
}

/// Limits the force of the row to ±max_force [N].
inline void limit_force(Row& row, double max_force, double h) {
  row.lower = std::max(row.lower, -max_force * h);
  row.upper = std::min(row.upper, max_force * h);
}

}  // namespace constraint_sim::engine
