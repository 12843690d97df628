#pragma once

#include <algorithm>
#include <cstdint>
#include <utility>

#include "constraint_sim/engine/event.h"
#include "engine/constraints/joint.h"
#include "engine/dynamics/method.h"
#include "engine/math/cone_problem.h"
#include "engine/math/integrate.h"
#include "engine/math/least_norm_solver.h"
#include "engine/math/list.h"
#include "engine/methods/event_driven/contacts/contact_equations.h"
#include "engine/methods/event_driven/joints/event_watch.h"

namespace constraint_sim::engine {

/// A few bodies that may touch each other in a span, with the joints on them, carried from event to
/// event: flight with the gaps as what is watched, impacts, contacts at rest as rows that stick or
/// slip; and the one-sided laws of the joints' coordinates, as EventDriven has them. All follows
/// from where the bodies are and how they move, and from what the states of joints say of motors;
/// nothing is kept from one span to the next but impulses, which add up, and storage.
class ContactEvents {
 public:
  static constexpr std::size_t kMostLaws = 32;        ///< more coordinates are left to others
  static constexpr std::uint32_t kMostEvents = 5000;  ///< in a step
  /// [m] an overlap of less is one of rounding, or of what another method has left, and closed.
  static constexpr double kMostOverlap = 1e-7;
  /// [m/s] a slip that ends there is off by no more than rounding
  static constexpr double kEndOfSlip = 1e-7;
  static constexpr double kSlipping = 1e-9;  ///< [m/s] a slip below has no direction of its own

  /// Two bodies with shapes that may touch, A first as has_features() has it, by their place in
  /// `equations`. Their contacts are the next ones.
  struct Pair {
    std::size_t a, b;
    Shape shape_a, shape_b;
    double friction, restitution;
    std::size_t first = 0, count = 0;  ///< of its contacts
    double thickness = 0.0;            ///< [m] of the thinner shape
    bool touched = false;              ///< in the step before,
    bool held = false, stuck = false;  ///< and did so at its end, as that left them
    bool is_still = false;             ///< somewhere, then

    bool is_of_boxes() const {
      return std::holds_alternative<Box>(shape_a) && std::holds_alternative<Box>(shape_b);
    }
    /// Whether the same features meet wherever the bodies are.
    bool has_fixed_features() const { return !std::holds_alternative<Box>(shape_b); }
  };

  /// What it is of, to be set before begin(): bodies and joints, without contacts, and pairs.
  ContactEquations& equations() { return equations_; }
  List<Pair>& pairs() { return pairs_; }

  /// In how many points two shapes may touch.
  static std::size_t most_points(const Shape& a, const Shape& b);

  /// Finds the contacts, open, and forgets all that was done. False where two shapes overlap by
  /// more than kMostOverlap, unless the first span `closes` such overlaps.
  bool begin(const List<BodyState>& states, bool closes);
  /// As method.h says. Not done: too many events, or no answer to one; the states are then those of
  /// any time within the span. `joint_step`, `joint_states`: of the span, of all joints.
  /// `most_work` may be done in the step.
  IntegrationResult advance(const SmoothSpan& span, const IntegratorOptions& accuracy,
                            const JointStep& joint_step, const List<JointState>& joint_states,
                            double most_work, List<BodyState>* states);

  // ---- what was done since the beginning
  std::uint32_t events() const { return done_.events; }
  double driven_work() const { return equations_.driven_work; }  ///< of what moves by itself [J]
  double work() const { return done_.work; }  ///< in substeps of a group of one point
  struct Told {
    EventKind kind;
    double time;     ///< simulated [s]
    int pair;        ///< −1 of a joint
    int coordinate;  ///< of equations(), of a joint
    double impulse;  ///< of an impact [N s or N m s]
    int joint = -1;  ///< of equations(), one that broke
  };
  const List<Told>& told() const { return told_; }
  const List<Pair>& pairs() const { return pairs_; }
  const ContactEquations& equations() const { return equations_; }
  /// Whether a contact holds now, or had an impulse.
  bool has_touched(std::size_t contact) const;
  /// Sets where motors with a force limit hold, and whether these have reached it.
  void write(std::size_t coordinate, JointState* state) const;

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
      kLimit,   ///< of a coordinate that is not at it
      kHeld,    ///< the force that holds one, to a bound
      kRate,    ///< of one that slips, whose motor or limit gives way, or that brakes; a servo's
                ///< force
      kBreak,   ///< the force or torque of a joint, to what it bears
    };
    Kind kind = Kind::kNothing;
    std::size_t contact = 0;
    std::size_t coordinate = 0;  ///< of the three before the last
    std::size_t joint = 0;       ///< of the last
    signed char side = 0;  ///< of a force that holds: -1 of its lower bound, +1 of its upper one

    bool is_of_contact() const { return kind != Kind::kNothing && kind < Kind::kLimit; }
  };
  /// A limit that takes part in an impact: +1 of a lower one, −1 of an upper one.
  struct LimitHit {
    std::size_t coordinate;
    double direction;
    double gap, rate;
    double restitution;
  };
  struct ContactHit {
    std::size_t contact;
    ContactMotion motion;
  };
  struct Hits {
    List<ContactHit> contacts;
    List<LimitHit> limits;

    bool empty() const { return contacts.empty() && limits.empty(); }
    void clear() {
      contacts.clear();
      limits.clear();
    }
  };
  /// Which bounce no more, or what impulses they had.
  template <class Number>
  struct Of {
    List<Number> contacts, coordinates;

    void reset(std::size_t contact_count, std::size_t coordinate_count) {
      contacts.assign(contact_count, Number{});
      coordinates.assign(coordinate_count, Number{});
    }
  };
  /// What impacts start from.
  struct BeforeImpacts {
    List<double> numbers;
    double driven_work = 0.0;
    List<ContactEquations::Contact> contacts;
    List<ContactEquations::BodyJoint> joints;
    List<ContactEquations::Coordinate> coordinates;
  };
  /// A coordinate that moves as something that holds it.
  struct Candidate {
    std::size_t coordinate;
    Hold hold;
    double rate, acceleration;
    ForceBounds bounds;
  };
  /// A contact that bears something, in a problem.
  struct Share {
    std::size_t contact;
    std::size_t column;  ///< of its normal force
    double friction;
    bool is_rough, sticks;
    Eigen::Vector2d direction;  ///< along tangents, of one that slips
  };
  /// Contacts whose force has reached a bound just now.
  struct AtBound {
    List<std::size_t> contacts;
    double since = 0.0;  ///< [s]

    bool has(std::size_t contact) const {
      return std::find(contacts.begin(), contacts.end(), contact) != contacts.end();
    }
  };
  /// What was done since the beginning.
  struct Done {
    std::uint32_t events = 0, impacts = 0, breaks = 0, jams = 0;
    int unchanged = 0;   ///< events that changed nothing
    int missed = 0;      ///< substeps that ended with boxes in each other, or too inexact
    double work = 0.0;   ///< substeps that were taken and problems solved, by what one costs
    bool spans = false;  ///< any span
  };
  /// A span in which nothing moved: what it began with, and what contacts did.
  struct Still {
    bool is_known = false;
    Eigen::Vector3d gravity{0, 0, 0};
    double h = 0.0;
    List<double> numbers;  ///< of movable bodies
    List<ContactEquations::Body> bodies;
    List<BodyState> states;  ///< at its end
    List<Pair> pairs;
    List<ContactEquations::Contact> contacts;  ///< at its end
  };
  struct Span {
    const SmoothSpan& all;
    const IntegratorOptions& accuracy;
    SubstepSpan left;
    IntegrationResult progress;
  };

  double find_overlaps(double margin);
  double beyond_limits() const;
  bool close_found(bool met);
  bool close_overlaps(Span* span, List<BodyState>* states);
  // ---- spans in which nothing moves (contact_stillness.cpp)
  bool is_as_when_still(const SmoothSpan& span) const;
  void note_beginning(const SmoothSpan& span);
  void note_stillness();
  void go_on_as_when_still(List<BodyState>* states);

  void begin_joints(const Span& span, const JointStep& step, const List<JointState>& states);
  void note_last_states();
  void note_positions();
  void give_way(std::size_t coordinate);
  void add_contacts();
  void find_features(bool all, bool is_within = false);
  void keep_places(const Pair& pair, bool all, List<ContactFeature>* found) const;
  bool has_changed() const;
  bool has_missed();
  double gap_of_boxes(const Pair& pair) const;
  double* derivative();

  // ---- between events
  double longest_substep(double left) const;
  void set_directions();
  void watch_forces(std::size_t contact, List<Watched>* list) const;
  void watch_held(std::size_t coordinate, List<Watched>* list) const;
  void watch_coordinate(std::size_t coordinate, List<Watched>* list) const;
  void watch_breaking(std::size_t joint, List<Watched>* list) const;
  void watch(List<Watched>* list);
  bool take(Span* span, SubstepSpan* left, double tolerance, double* step);
  bool repeat(Span* span, double t, double h, bool is_start);
  bool advance_to_event(Span* span);
  bool end_jam(Span* span);
  bool finish_event(Span* span, const Watched& watched, std::size_t which);

  // ---- slow slips (contact_straight.cpp)
  bool turns_fast(double h) const;
  bool was_straight(double h, double tolerance) const;
  bool go_straight(bool is_straight);
  bool take_first(Span* span, double* step);

  // ---- forces of redundant contacts (contact_sharing.cpp)
  void list_sharing();
  double mean_beside(const Share& of, const List<double>& force) const;
  double least_margin(const List<double>& force) const;
  bool find_shares(double beyond);
  void share_forces();

  // ---- at events (contact_states.cpp)
  bool settle(Span* span, const Watched& event, bool is_begin, bool jams = false);
  bool have_impacts(double left, Of<double>* hit);
  bool is_hit(double gap, double rate) const;
  void find_hits(const Of<char>& rests, Hits* hits) const;
  void add_touching_limits(const Of<char>& rests, bool only_slow, List<LimitHit>* hits) const;
  std::pair<std::size_t, std::size_t> bodies_of(const ContactEquations::Coordinate& of) const;
  bool have_impact(const Hits& hits, const Of<char>& rests, double faster, Of<double>* hit);
  bool solve_counted();
  bool does_work(const ContactEquations::Responses& responses) const;
  bool have_jam(Of<double>* hit);
  bool let_rest(double left, const Of<double>& hit, Of<char>* rests, bool* is_settled);
  void break_joint(const Span& span, std::size_t joint);
  bool break_overloaded(Span* span);
  void note_bounds(const Span& span, const Watched& event);
  bool decide(const Watched& event);
  bool decide(const Watched& event, double least_slip);
  void find_lost();
  double braking_of(std::size_t coordinate);
  void choose_servos();
  bool find_candidates(List<Candidate>* candidates);
  void begin_problem();
  static void set_rate(const ContactEquations::Touching& of, const Eigen::Vector3d& rate,
                       List<double>* all);
  void set_problem(double least_slip);
  void choose_acts();
  void find_solved_accelerations();
  void choose_holds(const Watched& event);
  void take_forces();
  bool is_within_bounds();
  void hold_coordinates(bool is_begin);
  void tell(const Span& span, const List<Acts>& before, const Of<double>& hit, bool is_begin);
  void tell_pair(double t, std::size_t pair, const List<Acts>& before, const Of<double>& hit,
                 bool is_begin);
  void add_told(const Told& told, double rests_in);
  bool is_saturated(std::size_t coordinate, const OneSidedState& state) const;

  ContactEquations equations_;
  List<Pair> pairs_;
  List<std::size_t> pair_of_;  // of contacts
  List<double> numbers_;       // of StageMemory
  List<double> kept_;          // state and derivative where the substep starts
  double step_ = 0.0;          // what the next substep is tried with [s]
  bool has_stages_ = false;    // of the last substep
  bool closes_ = false;        // overlaps, in the next span
  bool begins_ = false;        // a span, at what is settled now
  ContactEquations::Accelerations rates_;
  List<double> gap_acceleration_;         // of contacts, as decide() found it
  List<double> coordinate_acceleration_;  // the same of coordinates
  List<OneSidedState> states_before_;     // of coordinates, where the event is
  List<OneSidedState> last_states_;       // the same, where the span before ended
  List<char> was_saturated_;              // the same
  Of<double> rests_in_;                   // [s] after which bounces that are not followed are over
  WatchedSubstep<Watched> watched_;
  Done done_;
  double error_ = 0.0;  // of the substep that was repeated last, estimated [m]
  double most_work_ = 0.0;
  StopFlag stop_ = nullptr;    // of the span
  List<double> depth_;         // [m] of pairs of boxes, where the substep starts,
  List<double> depth_now_;     // and where it ends
  AtBound at_cone_, at_zero_;  // of friction, and of the force along the normal
  List<Told> told_;
  Still still_;  // the last one, where nothing has moved since

  // storage of what is done at one event
  ContactEquations::Responses responses_;
  ConeProblem problem_;
  ConeSolver solver_;
  List<double> force_, rate_, solved_;  // of the problem; rates before and after
  List<Share> shares_;
  List<double> shared_;
  LeastNormSolver sharing_;
  List<Candidate> held_;
  Hits hits_;
  Of<char> rests_;
  Of<double> hit_;
  BeforeImpacts before_impacts_;
  List<Acts> acts_before_;
  List<std::uint32_t> features_before_;  // their ids
  List<Watched> forces_;
  List<double> free_;            // a derivative: without what acts, or with all that was decided
  bool has_derivative_ = false;  // it is the latter
  List<double> before_projection_;
  List<ContactFeature> found_;
};

}  // namespace constraint_sim::engine
