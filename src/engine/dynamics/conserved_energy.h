#pragma once

#include "engine/dynamics/interval_inputs.h"
#include "engine/dynamics/island_model.h"
#include "engine/dynamics/kinematics.h"

namespace constraint_sim::engine {

/// Energy of an island when momentary rows were last left out [J], with potentials of loads and
/// springs. Bodies then move across the rows, whose forces do work when they act again, and
/// projections move bodies against loads and springs; restore() takes that change back.
class ConservedEnergy {
 public:
  bool is_known() const { return is_known_; }
  void forget() { is_known_ = false; }
  void set_known(bool is_known) { is_known_ = is_known; }
  /// Stores the energy of state y, at its pose.
  void note(const IslandModel& island, const IntervalInputs& inputs, const Kinematics& kinematics,
            const double* y);
  /// Scales the velocities of state y, at its pose, to restore the stored energy. Returns false
  /// where the change exceeds the work of forces over a short distance, and changes nothing.
  /// `scale`: size of the island [m].
  bool restore(const IslandModel& island, const IntervalInputs& inputs,
               const Kinematics& kinematics, double scale, double* y) const;

  /// Visits the stored energy, as engine/support/memory.h describes.
  template <class Self, class Visit>
  static void visit_memory(Self& self, Visit& visit) {
    visit(self.is_known_);
    if (self.is_known_) visit(self.energy_);
  }

 private:
  bool is_known_ = false;
  double energy_ = 0.0;  // [J]
};

/// Whether only joints, loads and springs act on an island held by the world. Drives, motors and
/// dampers do work; torques and laws of coordinates have no potential here; a free island has
/// momenta to conserve.
bool conserves_energy(const IslandModel& island, const IntervalInputs& inputs);

}  // namespace constraint_sim::engine
