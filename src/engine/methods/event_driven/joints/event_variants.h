#pragma once

#include "engine/constraints/one_sided_law.h"
#include "engine/dynamics/equations_of_motion.h"
#include "engine/math/list.h"
#include "engine/methods/event_driven/joints/event_joints.h"
#include "engine/methods/runge_kutta/runge_kutta.h"

namespace constraint_sim::engine {

/// Compiled equations of an event-driven island: without any one-sided row, and with the rows of
/// recent sets of states. RungeKutta holds the equations of the rows that act.
class EventVariants {
 public:
  EventVariants(const EventJoints& joints, const List<MassProperties>& masses);

  /// Equations without any one-sided row.
  const EquationsOfMotion& bare() const { return bare_; }
  EquationsOfMotion& bare() { return bare_; }
  void compile_bare(const EventJoints& joints, const List<char>& is_broken,
                    const List<MassProperties>& masses);
  /// Gives `motion` the equations for these states. Returns false where it has them already.
  bool switch_to(const EventJoints& joints, const List<OneSidedState>& states,
                 const List<char>& is_broken, const List<MassProperties>& masses,
                 RungeKutta* motion);
  /// Gives `motion` the bare equations, with which an island that was just compiled begins.
  void begin_anew(const EventJoints& joints, const List<char>& is_broken, RungeKutta* motion);

  /// Takes over the laws of the joints, `motion` included. Returns false where `motion` or the bare
  /// equations have to be compiled anew.
  bool follow_laws(const EventJoints& joints, const List<char>& is_broken, RungeKutta* motion);

  /// Visits the states that RungeKutta is compiled for, as engine/support/memory.h describes.
  /// compile_again() follows where they were read.
  template <class Self, class Visit>
  static void visit_memory(Self& self, Visit& visit) {
    visit.beside(self.compiled_for_);
    visit.beside(self.broken_then_);
  }
  /// Compiles the bare equations and the equations of the rows that act.
  void compile_again(const EventJoints& joints, const List<char>& is_broken,
                     const List<MassProperties>& masses, RungeKutta* motion);

 private:
  /// Compiled equations for one set of states.
  struct Variant {
    List<OneSidedState> states;
    List<char> is_broken;
    RungeKutta motion;
    bool has_old_laws = false;  ///< laws of joints have changed since the last use
  };
  bool is_up_to_date(const EventJoints& joints, Variant* variant) const;
  template <class Compile>
  bool switch_to(const EventJoints& joints, const List<OneSidedState>& states,
                 const List<char>& is_broken, const Compile& compile, RungeKutta* motion);

  EquationsOfMotion bare_;
  List<OneSidedState> compiled_for_;  // states that RungeKutta is compiled for
  List<char> broken_then_;            // joints that are broken in that compilation
  List<Variant> others_;              // earlier compilations, for reuse
};

}  // namespace constraint_sim::engine
