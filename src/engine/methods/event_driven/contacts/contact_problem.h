#pragma once

#include <Eigen/Core>
#include <cstddef>

#include "engine/math/cone_problem.h"
#include "engine/math/list.h"
#include "engine/math/numbers.h"
#include "engine/methods/event_driven/contacts/contact_responses.h"

namespace constraint_sim::engine {

/// Cone problem of impulses or forces at contacts and coordinates while the joints hold, and its
/// solution. The matrix of the problem are the responses.
struct ContactProblem {
  ContactResponses responses;  ///< responses of contacts and coordinates that take part
  ConeProblem cone;
  List<double> force;  ///< solution of `cone`

  /// Sets up `cone` from the responses, without rates, directions of slips and coordinates.
  void begin(const ContactEquations& equations) {
    cone.A = responses.A();
    cone.b.assign(responses.columns(), 0.0);
    cone.contacts.clear();
    cone.rows.clear();
    for (const TouchingContact& touching : responses.contacts()) {
      if (touching.is_rough)
        cone.contacts.push_back({equations.contacts()[touching.contact].friction});
      else
        cone.rows.push_back({0.0, kInfinity});
    }
  }
};

/// Writes components of a rate along the frame of a contact into the numbers of all columns.
inline void set_rate(const TouchingContact& of, const Eigen::Vector3d& rate, List<double>* all) {
  for (std::size_t k = 0; k < (of.is_rough ? 3 : 1); ++k)
    (*all)[of.column + k] = rate[static_cast<Eigen::Index>(k)];
}

}  // namespace constraint_sim::engine
