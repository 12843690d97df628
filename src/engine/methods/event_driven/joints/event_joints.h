#pragma once

#include <algorithm>
#include <cstddef>
#include <utility>

#include "engine/constraints/coupling.h"
#include "engine/constraints/one_sided_law.h"
#include "engine/dynamics/equations_of_motion.h"
#include "engine/math/list.h"

namespace constraint_sim::engine {

/// Joints of an event-driven island and their one-sided laws. Joints are numbered as in members().
class EventJoints {
 public:
  using Ends = List<std::pair<std::size_t, std::size_t>>;
  /// Joint with a breaking force or torque.
  struct Breaking {
    std::size_t joint;
    double force, torque;
  };

  /// `members`: indices of the joints of the island. `couplings`, `open`: as in EquationsOfMotion.
  EventJoints(const List<int>& members, const List<Joint>& all_joints, const Ends& ends,
              const List<CoupledTerms>& couplings, const List<char>& open);

  /// Takes over the laws of the joints. Returns false where these are other laws, by kind or by
  /// coordinate.
  bool follow_laws(const List<Joint>& all_joints);

  std::size_t size() const { return joints_.size(); }
  const List<int>& members() const { return members_; }
  const List<Joint>& joints() const { return joints_; }
  const Joint& operator[](std::size_t joint) const { return joints_[joint]; }
  /// Bodies of a joint.
  const std::pair<std::size_t, std::size_t>& ends(std::size_t joint) const { return ends_[joint]; }
  /// Terms of a coupling.
  const CoupledTerms& terms(std::size_t joint) const { return couplings_[joint]; }
  /// All laws, grouped by joint.
  const List<OneSidedLaw>& laws() const { return laws_; }
  /// First law of a joint, and the law behind its last one.
  std::pair<std::size_t, std::size_t> laws_of(std::size_t joint) const {
    return {first_law_[joint], first_law_[joint + 1]};
  }
  const List<Breaking>& breaking() const { return breaking_; }

  /// Copies a joint with its rows as the states of all laws say. Returns false where the joint does
  /// not act.
  bool with_rows(std::size_t joint, const List<OneSidedState>& states, Joint* result) const;
  /// Compiles the joints that are not broken, with rows as the states of all laws say.
  EquationsOfMotion compile(const List<OneSidedState>& states, const List<char>& is_broken,
                            const List<MassProperties>& masses) const;
  /// Lets equations, or RungeKutta with its own, take over the laws of the joints, with rows as the
  /// states of all laws say. Returns false where they have to be compiled anew.
  template <class Compiled>
  bool update(const List<OneSidedState>& states, const List<char>& is_broken,
              const List<int>& compiled_joints, Compiled* compiled) const {
    List<int> acting, idle;
    const List<Joint> joints = switched(states, is_broken, &acting, &idle);
    return std::is_permutation(acting.begin(), acting.end(), compiled_joints.begin(),
                               compiled_joints.end()) &&
           compiled->follow_laws(joints);
  }

 private:
  List<Joint> switched(const List<OneSidedState>& states, const List<char>& is_broken,
                       List<int>* acting, List<int>* idle) const;
  void add_laws(const Joint& joint);
  void add_coupling(const CoupledTerms& terms, std::size_t joint);

  List<int> members_;
  List<Joint> joints_;
  Ends ends_;
  List<char> open_;  // per joint: compiled as open; empty where none is open
  List<CoupledTerms> couplings_;
  List<OneSidedLaw> laws_;
  List<std::size_t> first_law_;  // per joint, then the end
  List<Breaking> breaking_;
};

}  // namespace constraint_sim::engine
