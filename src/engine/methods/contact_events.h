#pragma once

#include <cstdint>
#include <utility>
#include <vector>

#include "constraint_sim/engine/event.h"
#include "engine/linear/cone_problem.h"
#include "engine/methods/contact_equations.h"
#include "engine/methods/event_watch.h"
#include "engine/methods/integrate.h"
#include "engine/methods/method.h"

namespace constraint_sim::engine {

/// A few bodies that may touch each other in a span, with the rigid joints on them, carried from
/// event to event: flight with the gaps as what is watched, impacts, contacts at rest as rows that
/// stick or slip. All follows from where the bodies are and how they move; nothing is kept from one
/// span to the next but impulses, which add up.
class ContactEvents {
 public:
  /// More than this are left to others.
  static constexpr std::size_t kMostBodies = 8, kMostContacts = 32;
  static constexpr std::uint32_t kMostEvents = 5000;  ///< in a step
  /// [m] an overlap of less is one of rounding, or of what another method has left, and closed.
  static constexpr double kMostOverlap = 1e-7;

  /// Two bodies with shapes that may touch, A first as has_features() has it, by their place in
  /// `equations`. Their contacts are the next ones.
  struct Pair {
    std::size_t a, b;
    Shape shape_a, shape_b;
    double friction, restitution;
    std::size_t first = 0, count = 0;  ///< of its contacts
    double thickness = 0.0;            ///< [m] of the thinner shape
  };

  /// Of bodies and joints as `equations` has them, without contacts.
  ContactEvents(ContactEquations equations, std::vector<Pair> pairs);

  /// Finds the contacts, open. False where there are too many, or two shapes overlap by more than
  /// kMostOverlap.
  bool begin(const std::vector<BodyState>& states);
  /// As method.h says. Not done: too many events, or no answer to one; the states are then those of
  /// any time within the span.
  IntegrationResult advance(const SmoothSpan& span, const IntegratorOptions& accuracy,
                            std::vector<BodyState>* states);

  // ---- what was done since the beginning
  std::uint32_t events() const { return events_; }
  struct Told {
    EventKind kind;
    double time;  ///< simulated [s]
    std::size_t pair;
    double impulse;  ///< of an impact [N s]
  };
  const std::vector<Told>& told() const { return told_; }
  const std::vector<Pair>& pairs() const { return pairs_; }
  const ContactEquations& equations() const { return equations_; }
  /// Whether a contact holds now, or had an impulse.
  bool has_touched(std::size_t contact) const;

 private:
  using Acts = ContactEquations::Acts;
  struct Watched : WatchedValue {
    enum class Kind : char {
      kNothing,
      kGap,     ///< of an open contact
      kForce,   ///< along the normal of one that holds
      kCone,    ///< of one that sticks
      kSlip,    ///< along where it went, of one that slips
      kMargin,  ///< of its feature
    };
    Kind kind = Kind::kNothing;
    std::size_t contact = 0;
  };
  struct Span {
    const SmoothSpan& all;
    const IntegratorOptions& accuracy;
    SubstepSpan left;
    IntegrationResult progress;
  };

  void add_contacts();
  void find_features(bool all);
  double* derivative();

  // ---- between events
  double longest_substep(double left) const;
  void set_directions();
  void watch_forces(std::size_t contact, std::vector<Watched>* list) const;
  void watch(std::vector<Watched>* list);
  bool take(Span* span, SubstepSpan* left, double tolerance, double* step);
  bool repeat(Span* span, double t, double h, bool is_start);
  bool advance_to_event(Span* span);
  bool end_jam(Span* span);
  bool finish_event(Span* span, const Watched& watched, std::size_t which);

  // ---- at events (contact_states.cpp)
  bool settle(Span* span, const Watched& event, bool is_begin, bool jams = false);
  bool have_impacts(std::vector<double>* hit);
  std::vector<std::size_t> find_hits(const std::vector<char>& rests) const;
  bool have_impact(const std::vector<std::size_t>& hits, const std::vector<char>& rests,
                   double faster, std::vector<double>* hit);
  bool have_jam(std::vector<double>* hit);
  bool let_rest(const std::vector<double>& hit, std::vector<char>* rests, bool* is_settled);
  void note_cone(const Span& span, const Watched& event);
  bool decide(const Watched& event);
  bool decide(const Watched& event, double least_slip);
  void choose_acts(const Watched& event, const std::vector<std::size_t>& candidates,
                   const ContactEquations::Responses& responses, const ConeProblem& problem,
                   const Eigen::VectorXd& force);
  bool is_within_bounds();
  void tell(double t, const std::vector<Acts>& before, const std::vector<double>& hit,
            bool is_begin);

  ContactEquations equations_;
  std::vector<Pair> pairs_;
  std::vector<std::size_t> pair_of_;  // of contacts
  std::vector<double> numbers_;       // of StageMemory
  std::vector<double> kept_;          // state and derivative where the substep starts
  double step_ = 0.0;                 // what the next substep is tried with [s]
  bool has_stages_ = false;           // of the last substep
  ContactEquations::Accelerations rates_;
  std::vector<Eigen::Vector3d> acceleration_;  // ẇ of contacts, as decide() found it
  WatchedSubstep<Watched> watched_;
  std::uint32_t events_ = 0, impacts_ = 0, jams_ = 0;
  int unchanged_ = 0;                 // events that changed nothing
  std::vector<std::size_t> at_cone_;  // contacts whose friction has reached its bound just now
  double at_cone_since_ = 0.0;        // [s]
  std::vector<Told> told_;
};

}  // namespace constraint_sim::engine
