// Runs copies of a world by several methods and compares them. World::step() does not use this
// file.

#include "constraint_sim/engine/verify.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <map>
#include <utility>

#include "engine/math/list.h"
#include "engine/model/validate.h"
#include "engine/world/world_impl.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

/// Growth of a perturbation beyond which a run is chaotic: the perturbed twin is then as far away
/// as the run of a faulty engine.
constexpr double kMostVerifiedGrowth = 1e7;
/// Assumed error of the other method, in distances between its runs with the whole and half step.
constexpr double kOtherMargin = 10.0;
/// Largest change of velocity by which the twin is perturbed [m/s].
constexpr double kMostPerturbingPush = 1e-6;

/// Returns the method of the comparison run. Sequential impulses are compared with `method: auto`.
Method method_to_compare_with(const World& world) {
  const Method method = world.options().method;
  if (uses_impulses(method)) return Method::kAuto;
  if (method == Method::kEnergyMomentum) return Method::kRungeKutta;
  for (const Island& island : world.islands())
    if (island.joints > 0 && island.method != Method::kEnergyMomentum)
      return Method::kEnergyMomentum;
  return Method::kRungeKutta;
}

/// Draws numbers in [-1, 1) by splitmix64 (Steele, Lea & Flood 2014), which is equal on all
/// machines.
class PerturbationDraw {
 public:
  double number() {
    state_ += 0x9e3779b97f4a7c15ULL;
    std::uint64_t z = state_;
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9ULL;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebULL;
    z ^= z >> 31;
    return static_cast<double>(z >> 11) * 0x1p-52 - 1.0;
  }
  Vector3d direction() {
    for (;;) {
      const double x = number(), y = number();
      const Vector3d v(x, y, number());
      const double square = v.squaredNorm();
      if (square > 0.01 && square <= 1.0) return v / std::sqrt(square);
    }
  }

 private:
  std::uint64_t state_ = 0;
};

double verified_distance(const BodyState& a, const BodyState& b, double radius) {
  const double angle = 2.0 * (a.orientation.conjugate() * b.orientation).vec().norm();
  return std::max((a.position - b.position).norm(), radius * angle);
}

/// Estimated error of a body.
struct VerifiedEstimate {
  double sum = 0.0;     // sum of local errors [m]
  std::string without;  // why the body has no estimate; empty: it has one
};

/// One of the runs, with the estimate of each body.
struct VerifiedRun {
  World world;
  std::map<BodyId, VerifiedEstimate> estimates;  // a body that always rested has no entry
  std::string end;                               // why the run ended early; empty: it did not

  VerifiedRun(const World& of, StopFlag stop) : world(of) {
    world.set_clock(nullptr);
    world.set_stop_flag(stop);
  }
  const auto& insides() const { return ImplAccess::of(world); }

  void step(const std::function<void(World&)>& before_tick, int steps) {
    if (!end.empty()) return;
    if (before_tick) before_tick(world);
    for (int k = 0; k < steps; ++k) {
      const StepReport& report = world.step();
      if (report.outcome.stopped) end = "stopped";
      if (report.outcome.failed)
        end = "failed after " + shortest(world.time()) + " s: " + to_string(report.outcome.failure);
      if (!end.empty()) return;
      add_estimates();
    }
  }

  // Adds the local errors of islands; bodies that touch share the larger sum.
  void add_estimates() {
    const auto& impl = insides();
    for (const int i : impl.sleep.awake().islands) {
      const auto island = static_cast<std::size_t>(i);
      const double local_error = impl.islands[island].local_error;
      const bool has_none = uses_impulses(impl.islands[island].method) || std::isnan(local_error);
      for (const int b : impl.island_parts[island].members.bodies) {
        VerifiedEstimate& estimate = estimates[impl.body_ids[static_cast<std::size_t>(b)]];
        if (has_none)
          leave_without(&estimate, std::string(name(impl.islands[island].method)) +
                                       " has no estimate (" + to_string(impl.islands[island].why) +
                                       ")");
        else
          estimate.sum += local_error;
      }
    }
    for (const auto& [id_a, id_b] : touching()) {
      VerifiedEstimate &a = estimates[id_a], &b = estimates[id_b];
      a.sum = b.sum = std::max(a.sum, b.sum);
      leave_without(&a, b.without);
      leave_without(&b, a.without);
    }
  }

  // Movable bodies that touch each other at the end of the last step or touched within it.
  List<std::pair<BodyId, BodyId>> touching() const {
    List<std::pair<BodyId, BodyId>> found;
    const auto& impl = insides();
    const auto add = [&](BodyId a, BodyId b) {
      if (a != b && impl.is_movable(impl.index(a)) && impl.is_movable(impl.index(b)))
        found.emplace_back(a, b);
    };
    for (const Contact& contact : world.contacts()) add(contact.body_a, contact.body_b);
    for (const Event& event : world.events())
      if (event.kind == EventKind::kContactBegan || event.kind == EventKind::kHit)
        add(event.body_a, event.body_b);
    return found;
  }

  static void leave_without(VerifiedEstimate* estimate, const std::string& why) {
    if (estimate->without.empty()) estimate->without = why;
  }

  double estimate(BodyId body) const {
    return why_without(body).empty() ? estimate_of(body).sum : VerifiedFigures::kLeftOut;
  }
  const std::string& why_without(BodyId body) const { return estimate_of(body).without; }
  const VerifiedEstimate& estimate_of(BodyId body) const {
    static const VerifiedEstimate kNoError;
    const auto found = estimates.find(body);
    return found != estimates.end() ? found->second : kNoError;
  }
  const BodyState& state(BodyId body) const { return insides().states[insides().index(body)]; }
  std::size_t island_number(BodyId body) const {
    return static_cast<std::size_t>(insides().topology.island_of(insides().index(body)));
  }
  const Island& island_of(BodyId body) const { return insides().islands[island_number(body)]; }
};

/// Runs and compares.
class Verification {
 public:
  Verification(const World& world, const VerifyOptions& options)
      : options_(options),
        base_(world, options.stop),
        half_(world, options.stop),
        other_(world, options.stop),
        other_half_(world, options.stop),
        twin_(world, options.stop) {
    report_.time_step = world.options().time_step;
    report_.method = world.options().method;
    report_.other_method = method_to_compare_with(base_.world);
    WorldOptions changed = world.options();
    const double tolerance = changed.tolerance;
    changed.tolerance = finer(tolerance);
    halve_step(changed, &half_);
    changed.method = report_.other_method;
    halve_step(changed, &other_half_);
    changed.tolerance = tolerance;
    other_.world.set_options(changed);
    perturb();
    list_bodies();
  }

  VerifyReport run() {
    for (std::uint64_t tick = 0; tick < options_.ticks; ++tick) {
      base_.step(options_.before_tick, 1);
      half_.step(options_.before_tick, 2);
      other_.step(options_.before_tick, 1);
      other_half_.step(options_.before_tick, 2);
      twin_.step(options_.before_tick, 1);
      for (const VerifiedRun* of : {&base_, &half_, &other_, &other_half_, &twin_})
        report_.stopped |= of->world.report().outcome.stopped;
      if (report_.stopped) break;
      if (!base_.end.empty()) {
        report_.failure = base_.end;
        break;
      }
      if (is_body_lost()) break;
      compare();
      note_warnings();
      if (base_.world.report().unresolved_bodies > 0) note_unresolved();
      ++report_.ticks;
      if (options_.progress) options_.progress(report_.ticks);
    }
    return std::move(report_);
  }

 private:
  struct Tracked {
    BodyId id;
    double radius;  // radius of gyration [m]: turns an angle into a distance
  };

  // Returns a tolerance that halves the substeps of a method of order 4. With equal tolerances the
  // runs at h and h/2 may have the same substeps, and no difference to tell.
  static double finer(double tolerance) {
    constexpr double kFinest = 1e-13;  // [m/s] finer is beyond rounding
    return std::min(tolerance, std::max(tolerance / 16.0, kFinest));
  }

  static void halve_step(WorldOptions options, VerifiedRun* run) {
    options.time_step *= 0.5;
    try {
      run->world.set_options(options);
    } catch (const std::invalid_argument& error) {
      run->end = error.what();
    }
  }

  // Perturbs the velocities of the twin's awake dynamic bodies by wrenches of one step. Sleeping
  // bodies stay asleep until a perturbed body reaches them.
  void perturb() {
    World& world = twin_.world;
    const auto& impl = twin_.insides();
    const double h = report_.time_step;
    const double push = std::min(options_.perturbation / h, kMostPerturbingPush);
    report_.perturbation = push * h;
    PerturbationDraw draw;
    Wrench wrench;
    wrench.start = world.time();
    wrench.end = world.time() + h;
    for (std::size_t i = 0; i < impl.bodies.size(); ++i) {
      if (!impl.is_movable(i) || impl.asleep[i]) continue;
      const MassProperties& mass = impl.masses[i];
      wrench.body = impl.body_ids[i];
      wrench.force = push / (h * mass.inverse_mass) * draw.direction();
      wrench.torque.setZero();
      if (mass.can_turn()) {
        const double spin = push / mass.radius_of_gyration();
        wrench.torque = impl.states[i].orientation *
                        Vector3d(spin / h * mass.inertia.cwiseProduct(draw.direction()));
      }
      world.add_wrench(wrench);
    }
  }

  void list_bodies() {
    const auto& impl = base_.insides();
    for (std::size_t i = 0; i < impl.bodies.size(); ++i) {
      if (!impl.is_movable(i)) continue;
      bodies_.push_back({impl.body_ids[i], impl.masses[i].radius_of_gyration()});
      report_.bodies.emplace_back();
      report_.bodies.back().name = impl.bodies[i].name;
    }
  }

  // Whether a command has removed a compared body from a run, where the comparison ends.
  bool is_body_lost() {
    for (std::size_t k = 0; k < bodies_.size(); ++k) {
      for (const VerifiedRun* of : {&base_, &half_, &other_, &other_half_, &twin_}) {
        if (of->insides().find(bodies_[k].id) >= 0) continue;
        report_.failure = "ended where body " + in_quotes(report_.bodies[k].name) + " was removed";
        return true;
      }
    }
    return false;
  }

  void note_warnings() {
    for (const StepWarning& now : base_.world.warnings()) {
      if (info(now.kind).is_notice) continue;
      const auto known = std::find_if(report_.warnings.begin(), report_.warnings.end(),
                                      [&](const StepWarning& before) {
                                        return before.kind == now.kind && before.name == now.name;
                                      });
      if (known == report_.warnings.end())
        report_.warnings.push_back(now);
      else
        known->value = std::max(known->value, now.value);
    }
  }

  void note_unresolved() {
    for (const BodyId id : base_.world.unresolved_bodies())
      for (std::size_t k = 0; k < bodies_.size(); ++k)
        if (bodies_[k].id == id) report_.bodies[k].is_unresolved = true;
  }

  void compare() {
    find_other_errors();
    leave_out_half_steps();
    for (std::size_t k = 0; k < bodies_.size(); ++k) compare(bodies_[k], &report_.bodies[k]);
  }

  // Finds the largest distance so far between the runs of the other method, for all bodies of an
  // island: two wrong runs may coincide for a moment, and bodies of an island share their errors.
  void find_other_errors() {
    other_errors_.assign(base_.insides().islands.size(), 0.0);
    for (std::size_t k = 0; k < bodies_.size(); ++k) {
      const Tracked& body = bodies_[k];
      double& largest = other_errors_[base_.island_number(body.id)];
      const double known = report_.bodies[k].figures.other_error;
      largest = std::max(
          {largest, std::isnan(known) ? 0.0 : known, distance_between(other_, other_half_, body)});
    }
  }

  // Leaves out the comparison with h/2 for bodies that only the first run has an estimate for, and
  // for all that touch them.
  void leave_out_half_steps() {
    for (std::size_t k = 0; k < bodies_.size(); ++k) {
      const BodyId id = bodies_[k].id;
      std::string& why = report_.bodies[k].no_half_step;
      if (why.empty()) why = half_.end;
      if (why.empty() && std::isnan(half_.estimate(id)) && !std::isnan(base_.estimate(id)))
        why = half_.why_without(id);
    }
    const auto why_of = [&](BodyId id) -> std::string* {
      for (std::size_t k = 0; k < bodies_.size(); ++k)
        if (bodies_[k].id == id) return &report_.bodies[k].no_half_step;
      return nullptr;  // added by a command
    };
    for (const VerifiedRun* const run : {&base_, &half_}) {
      for (const auto& [a, b] : run->touching()) {
        std::string* const of_a = why_of(a);
        std::string* const of_b = why_of(b);
        if (of_a == nullptr || of_b == nullptr) continue;
        if (of_a->empty()) *of_a = *of_b;
        if (of_b->empty()) *of_b = *of_a;
      }
    }
  }

  void compare(const Tracked& body, VerifiedBody* verified) {
    if (verified->chaotic_from) return;
    const auto distance_to = [&](const VerifiedRun& of) {
      return distance_between(base_, of, body);
    };
    VerifiedFigures& figures = verified->figures;
    figures.time = base_.world.time();
    figures.estimate = base_.estimate(body.id);
    verified->no_estimate = base_.why_without(body.id);
    if (twin_.end.empty())
      figures.growth = std::max(figures.growth, distance_to(twin_) / report_.perturbation);
    if (figures.growth > kMostVerifiedGrowth) {
      verified->chaotic_from = figures.time;
      return;
    }
    const double half_estimate = half_.estimate(body.id);
    figures.half_step =
        verified->no_half_step.empty() ? distance_to(half_) : VerifiedFigures::kLeftOut;
    if (verified->no_other_method.empty()) verified->no_other_method = why_not_other(body.id);
    const bool has_other = verified->no_other_method.empty();
    figures.other_method = has_other ? distance_to(other_half_) : VerifiedFigures::kLeftOut;
    figures.other_error =
        has_other ? other_errors_[base_.island_number(body.id)] : VerifiedFigures::kLeftOut;
    if (verified->exceeded) return;
    const double own = estimate_or_zero(figures.estimate);
    if (exceeds(figures.half_step, figures.growth * (own + estimate_or_zero(half_estimate)), 0.0) ||
        exceeds(figures.other_method, figures.growth * own, kOtherMargin * figures.other_error))
      verified->exceeded = figures;
  }

  static double distance_between(const VerifiedRun& a, const VerifiedRun& b, const Tracked& of) {
    return verified_distance(a.state(of.id), b.state(of.id), of.radius);
  }

  // Returns 0 for a missing estimate: a run without an estimate claims to be exact.
  static double estimate_or_zero(double estimate) { return std::isnan(estimate) ? 0.0 : estimate; }

  bool exceeds(double difference, double error, double of_other) const {
    return difference > options_.least && difference > options_.margin * error + of_other;
  }

  // Returns the reason why a body is not compared with the other method from now on, or "".
  std::string why_not_other(BodyId body) const {
    for (const VerifiedRun* of : {&other_, &other_half_}) {
      const std::string why = why_not(*of, body);
      if (!why.empty()) return why;
    }
    return "";
  }

  std::string why_not(const VerifiedRun& run, BodyId body) const {
    if (!run.end.empty()) return std::string(name(report_.other_method)) + ": " + run.end;
    const Island& island = base_.island_of(body);
    const Island& other = run.island_of(body);
    if (island.why == MethodReason::kAtRest || other.why == MethodReason::kAtRest) return "";
    if (uses_impulses(other.method))
      return "no second method has an estimate for what " + reason(other.why);
    if (island.method == Method::kEventDriven)
      return "no second method advances what " + reason(island.why);
    if (!uses_impulses(island.method)) {
      if (other.method == Method::kEventDriven)
        return "no second method advances what " + reason(other.why);
      if (island.joints == 0)
        return "a body without joints moves by the same formulas in every method";
      if (island.method == other.method)
        return std::string(name(island.method)) + " advances it in both runs";
    }
    if (other.unresolved_bodies > 0)
      return std::string(name(other.method)) + " does not resolve its motion at this time step";
    return "";
  }

  static std::string reason(MethodReason why) {
    const std::string text = to_string(why);
    return text.rfind("has ", 0) == 0 ? text : "is " + text;
  }

  const VerifyOptions& options_;
  List<double> other_errors_;  // [m], by island of base_
  VerifiedRun base_, half_, other_, other_half_, twin_;
  List<Tracked> bodies_;
  VerifyReport report_;
};

std::string verified_figure(double value) {
  if (std::isnan(value)) return "-";
  char text[32];
  std::snprintf(text, sizeof text, "%.2g", value);
  return text;
}

}  // namespace

const char* VerifiedBody::verdict() const {
  if (exceeded) return "exceeds";
  return chaotic_from ? "chaotic" : "holds";
}

bool VerifyReport::exceeds() const {
  return std::any_of(bodies.begin(), bodies.end(),
                     [](const VerifiedBody& body) { return body.exceeded.has_value(); });
}

VerifyReport verify(const World& world, const VerifyOptions& options) {
  check_positive("perturbation", options.perturbation);
  check_not_negative("least", options.least);
  check_finite("margin", options.margin);
  if (options.margin < 1.0) refuse("margin", "must be at least 1, got " + shortest(options.margin));
  return Verification(world, options).run();
}

std::string to_table(const VerifyReport& report) {
  constexpr std::size_t kColumns = 8;
  using Line = std::array<std::string, kColumns>;
  List<Line> lines{{"body", "estimate [m]", "growth", "global error [m]", "h/2 [m]",
                    std::string(name(report.other_method)) + " [m]", "verdict", "until [s]"}};
  List<std::pair<std::string, std::string>> notes;  // and the first body of each
  const auto note = [&](const std::string& what, const VerifiedBody& body) {
    if (what.empty()) return;
    for (const auto& [known, first] : notes)
      if (known == what) return;
    notes.emplace_back(what, body.name);
  };
  for (const VerifiedBody& body : report.bodies) {
    const VerifiedFigures& shown = body.exceeded ? *body.exceeded : body.figures;
    lines.push_back({body.name, verified_figure(shown.estimate), verified_figure(shown.growth),
                     verified_figure(shown.global_error()), verified_figure(shown.half_step),
                     verified_figure(shown.other_method), body.verdict(),
                     verified_figure(shown.time)});
    if (!body.no_estimate.empty()) note("no estimate: " + body.no_estimate, body);
    if (body.is_unresolved) note("it moves faster than the time step resolves", body);
    if (!body.no_half_step.empty()) note("h/2 left out: " + body.no_half_step, body);
    if (!body.no_other_method.empty())
      note(std::string(name(report.other_method)) + " left out: " + body.no_other_method, body);
  }
  std::array<std::size_t, kColumns> widths{};
  for (const Line& line : lines)
    for (std::size_t i = 0; i < kColumns; ++i) widths[i] = std::max(widths[i], line[i].size());
  std::string table;
  for (const Line& line : lines) {
    std::string text;
    for (std::size_t i = 0; i < kColumns; ++i)
      text += line[i] + std::string(i + 1 < kColumns ? widths[i] + 2 - line[i].size() : 0, ' ');
    table += text + "\n";
  }
  for (const auto& [what, first] : notes) table += what + "; first of " + in_quotes(first) + "\n";
  if (!report.failure.empty()) table += "the run " + report.failure + "\n";
  if (report.stopped) table += "stopped after " + std::to_string(report.ticks) + " ticks\n";
  return table;
}

}  // namespace constraint_sim::engine
