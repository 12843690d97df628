#pragma once

// One-sided elements and force limits in Simbody: constraints that event handlers switch on and
// off, as its documentation recommends. Its integrator locates the events.

#include <Simbody.h>

#include <functional>
#include <memory>
#include <utility>
#include <vector>

namespace constraint_sim::report {

/// A constraint that is switched on and off.
class SimbodyLaw {
 public:
  explicit SimbodyLaw(const SimTK::SimbodyMatterSubsystem& matter) : matter_(matter) {}
  SimbodyLaw(const SimbodyLaw&) = delete;
  SimbodyLaw& operator=(const SimbodyLaw&) = delete;
  virtual ~SimbodyLaw() = default;

  struct Trigger {
    SimTK::Stage stage;
    std::function<double(const SimTK::State&)> value;  ///< an event where it rises through 0
  };
  virtual std::vector<Trigger> triggers() = 0;
  /// Switches constraints as necessary; returns whether any was switched. The state is that of an
  /// event, or the first one.
  virtual bool settle(SimTK::State* state) = 0;

 protected:
  static constexpr double kTouches =
      1e-9;  // distance to a limit that counts as at the limit [m, rad or their rates]

  const SimTK::System& system() const { return matter_.getSystem(); }
  double multiplier(const SimTK::Constraint& of, const SimTK::State& state) const {
    system().realize(state, SimTK::Stage::Acceleration);
    return of.getMultipliersAsVector(state)[0];
  }
  /// Reverses the velocities that active constraints forbid, with this restitution.
  void strike(double restitution, SimTK::State* state) const {
    system().realize(*state, SimTK::Stage::Velocity);
    const SimTK::Vector change = -(1.0 + restitution) * state->getUErr();
    SimTK::Vector impulse, force, speeds;
    matter_.solveForConstraintImpulses(*state, change, impulse);
    matter_.multiplyByGTranspose(*state, impulse, force);
    matter_.multiplyByMInv(*state, force, speeds);
    state->updU() += speeds;
    system().realize(*state, SimTK::Stage::Velocity);
  }

 private:
  const SimTK::SimbodyMatterSubsystem& matter_;
};

/// A rope or a stop.
class SimbodyStop : public SimbodyLaw {
 public:
  /// `gap` [m or rad] is the remaining distance, with its `rate`; the constraint, inactive at
  /// first, holds while side times its multiplier is positive.
  struct Gap {
    std::function<double(const SimTK::State&)> gap, rate;
    double side = 1.0;
  };
  SimbodyStop(const SimTK::SimbodyMatterSubsystem& matter, const SimTK::Constraint& constraint,
              Gap gap, double restitution)
      : SimbodyLaw(matter),
        constraint_(constraint),
        gap_(std::move(gap)),
        restitution_(restitution) {}

  /// Events: the gap closes; the gap's rate reverses, without which a flight shorter than a step
  /// would be missed; the constraint releases.
  std::vector<Trigger> triggers() override {
    return {{SimTK::Stage::Position,
             [this](const SimTK::State& state) { return holds(state) ? -1.0 : -gap_.gap(state); }},
            {SimTK::Stage::Velocity,
             [this](const SimTK::State& state) { return holds(state) ? -1.0 : -gap_.rate(state); }},
            {SimTK::Stage::Acceleration, [this](const SimTK::State& state) {
               return holds(state) ? -gap_.side * constraint_.getMultipliersAsVector(state)[0]
                                   : -1.0;
             }}};
  }

  bool settle(SimTK::State* state) override {
    system().realize(*state, SimTK::Stage::Velocity);
    if (holds(*state)) {
      if (gap_.side * multiplier(constraint_, *state) >= 0.0) return false;
      constraint_.disable(*state);
      return true;
    }
    const double rate = gap_.rate(*state);
    if (gap_.gap(*state) > kTouches || rate > kTouches) return false;
    constraint_.enable(*state);
    const bool bounces = -restitution_ * rate > kCaptured;
    strike(bounces ? restitution_ : 0.0, state);
    if (!bounces && gap_.side * multiplier(constraint_, *state) >= 0.0) return true;
    constraint_.disable(*state);
    return bounces;
  }

 private:
  static constexpr double kCaptured = 1e-5;  // slower impacts do not bounce [m/s or rad/s]

  bool holds(const SimTK::State& state) const { return !constraint_.isDisabled(state); }

  SimTK::Constraint constraint_;
  Gap gap_;
  double restitution_;
};

/// Coulomb friction along a coordinate, or a motor with a force limit: holds the speed with at most
/// `limit`, and applies `limit` beyond.
class SimbodyDrive : public SimbodyLaw {
 public:
  SimbodyDrive(SimTK::SimbodyMatterSubsystem* matter, SimTK::GeneralForceSubsystem* forces,
               SimTK::MobilizedBody* body, double rate, double limit)
      : SimbodyLaw(*matter),
        body_(*body),
        constraint_(*body, rate),
        force_(*forces, *body, SimTK::MobilizerUIndex(0), 0.0),
        rate_(rate),
        limit_(limit) {
    constraint_.setDisabledByDefault(true);
  }

  /// Events: the speed is reached, and holding it exceeds the limit.
  std::vector<Trigger> triggers() override {
    return {{SimTK::Stage::Velocity,
             [this](const SimTK::State& state) {
               const double pull = force_.getMobilityForce(state);
               return holds(state) ? -1.0 : (pull > 0.0 ? 1.0 : -1.0) * slip(state);
             }},
            {SimTK::Stage::Acceleration, [this](const SimTK::State& state) {
               return holds(state) ? std::abs(constraint_.getMultipliersAsVector(state)[0]) - limit_
                                   : -1.0;
             }}};
  }

  bool settle(SimTK::State* state) override {
    system().realize(*state, SimTK::Stage::Velocity);
    const bool held = holds(*state);
    const double before = force_.getMobilityForce(*state);
    double pull = slip(*state) > 0.0 ? -limit_ : limit_;
    if (held || std::abs(slip(*state)) <= kTouches || slip(*state) * before > 0.0) {
      constraint_.enable(*state);
      force_.setMobilityForce(*state, 0.0);
      if (!held) strike(0.0, state);
      const double load = multiplier(constraint_, *state);
      if (std::abs(load) <= limit_) return !held;
      pull = load > 0.0 ? -limit_ : limit_;
      constraint_.disable(*state);
    }
    force_.setMobilityForce(*state, pull);
    return held || pull != before;
  }

 private:
  bool holds(const SimTK::State& state) const { return !constraint_.isDisabled(state); }
  double slip(const SimTK::State& state) const { return body_.getOneU(state, 0) - rate_; }

  SimTK::MobilizedBody body_;
  SimTK::Constraint::ConstantSpeed constraint_;
  SimTK::Force::MobilityDiscreteForce force_;
  double rate_, limit_;
};

/// A rod that breaks for good beyond a force limit.
class SimbodyBreaking : public SimbodyLaw {
 public:
  SimbodyBreaking(const SimTK::SimbodyMatterSubsystem& matter, const SimTK::Constraint::Rod& rod,
                  double limit)
      : SimbodyLaw(matter), rod_(rod), limit_(limit) {}

  std::vector<Trigger> triggers() override {
    return {{SimTK::Stage::Acceleration, [this](const SimTK::State& state) {
               return rod_.isDisabled(state) ? -1.0 : std::abs(rod_.getRodTension(state)) - limit_;
             }}};
  }

  bool settle(SimTK::State* state) override {
    if (rod_.isDisabled(*state)) return false;
    system().realize(*state, SimTK::Stage::Acceleration);
    // the event may be located just below the limit
    if (std::abs(rod_.getRodTension(*state)) < limit_ * (1.0 - kTouches)) return false;
    rod_.disable(*state);
    return true;
  }

 private:
  SimTK::Constraint::Rod rod_;
  double limit_;
};

/// All laws of a system. They must be added before its topology is realized.
class SimbodyLaws {
 public:
  void add(std::unique_ptr<SimbodyLaw> law, SimTK::MultibodySystem* system) {
    for (SimbodyLaw::Trigger& trigger : law->triggers())
      system->addEventHandler(new Handler(std::move(trigger), this));
    laws_.push_back(std::move(law));
  }
  bool empty() const { return laws_.empty(); }
  /// Settles laws until nothing changes.
  void settle(SimTK::State* state) const {
    for (int round = 0; round < kRounds; ++round) {
      bool has_changed = false;
      for (const auto& law : laws_)
        if (law->settle(state)) has_changed = true;
      if (!has_changed) return;
    }
  }

 private:
  static constexpr int kRounds = 20;

  class Handler : public SimTK::TriggeredEventHandler {
   public:
    Handler(SimbodyLaw::Trigger trigger, const SimbodyLaws* laws)
        : TriggeredEventHandler(trigger.stage), trigger_(std::move(trigger)), laws_(*laws) {
      getTriggerInfo().setTriggerOnFallingSignTransition(false);
    }
    SimTK::Real getValue(const SimTK::State& state) const override { return trigger_.value(state); }
    void handleEvent(SimTK::State& state, SimTK::Real, bool&) const override {
      laws_.settle(&state);
    }

   private:
    SimbodyLaw::Trigger trigger_;
    const SimbodyLaws& laws_;
  };

  std::vector<std::unique_ptr<SimbodyLaw>> laws_;
};

}  // namespace constraint_sim::report
