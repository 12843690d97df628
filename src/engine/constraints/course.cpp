#include "engine/constraints/course.h"

namespace constraint_sim::engine {

Prescribed closing_course(double since, double closing_time) {
  const double u = since / closing_time;
  if (u >= 1.0) return {};
  return {1.0 - u * u * u * (10.0 - u * (15.0 - 6.0 * u)),
          -30.0 * u * u * (1.0 - u) * (1.0 - u) / closing_time,
          -60.0 * u * (1.0 - u) * (1.0 - 2.0 * u) / (closing_time * closing_time)};
}

}  // namespace constraint_sim::engine
