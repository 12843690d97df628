#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>

#include "engine/dynamics/interval_inputs.h"
#include "engine/dynamics/island_model.h"
#include "engine/dynamics/turned_angles.h"
#include "engine/math/list.h"

namespace constraint_sim::engine {

class Kinematics;

/// Positions and rates of soft coordinates, coupled coordinates and all other angles of an island,
/// noted after each substep. A pose determines an angle up to whole turns; the noted position and
/// its rate select the turn.
class CoordinatePositions {
 public:
  explicit CoordinatePositions(const IslandModel& island);

  /// Reads positions from `states`, one entry per joint of the world.
  void begin_step(const IslandModel& island, const List<JointData>& states);
  /// Sets the time of the noted positions [s].
  void set_time(double t) { angles_.set_time(t); }
  /// Notes the positions and rates of a pose with its velocities.
  void note(const IslandModel& island, const IntervalInputs& inputs, const Kinematics& kinematics);
  void note_soft(std::size_t soft, double position, double rate) {
    softs_[soft] = {position, rate};
  }
  void note_term(std::size_t coupled, std::size_t term, double position, double rate) {
    coupled_[coupled].terms[term] = {position, rate};
  }
  /// Notes the angles that neither springs nor couplings read, as TurnedAngles::integrate().
  template <class Spin, class Axis>
  void note_angles(double t, const Spin& spin, const Axis& axis) {
    angles_.integrate(t, spin, axis);
  }
  /// Adds to an angle of link l that neither springs nor couplings read, and sets its rate.
  void turn_angle(std::size_t l, int coordinate, double by, double rate) {
    angles_.turn(l, coordinate, by, rate);
  }
  /// Sets the position of a soft coordinate, or of a term of a coupling [m or rad], at a time of
  /// which nothing is known about its rate.
  void set_soft(std::size_t soft, double position) { softs_[soft] = {position, 0.0}; }
  void set_term(std::size_t coupled, std::size_t term, double position) {
    coupled_[coupled].terms[term] = {position, 0.0};
  }
  /// Adds the rotations of a step of length h [s], which ends at time t [s], to the angles that
  /// neither springs nor couplings read. `turn(body)`: rotation vector of a rotating body [rad];
  /// `axis(link, end)`: axis z of a general joint on A (0) or B (1) in the step.
  template <class Turn, class Axis>
  void add_turns(const IslandModel& island, const IntervalInputs& inputs, double t, double h,
                 const Turn& turn, const Axis& axis) {
    const auto turn_of = [&](std::size_t point) -> Eigen::Vector3d {
      if (island.rotates(point)) return turn(point);
      if (point < island.bodies().size()) return Eigen::Vector3d::Zero();
      return h * inputs.fixed_angular_velocity(point);
    };
    angles_.add_turns(t, turn_of, [&](const TurnedAngles::Angle& angle) {
      return axis(angle.joint, angle.is_about_b ? 1 : 0);
    });
  }
  /// Time of the noted positions [s].
  double time() const { return angles_.time(); }
  /// Saves all positions; restore() returns to them.
  void keep();
  void restore();

  bool empty() const { return softs_.empty() && coupled_.empty() && angles_.empty(); }
  /// Noted position of a soft coordinate, or of a term of a coupling [m or rad].
  double soft(std::size_t soft) const { return softs_[soft].position; }
  double term(std::size_t coupled, std::size_t term) const {
    return coupled_[coupled].terms[term].position;
  }
  /// Constant of coupled row c.
  double constant(std::size_t c) const { return coupled_[c].constant; }
  /// Position of a soft coordinate at the pose of `kinematics` [m or rad], whole turns included;
  /// `rate`: its rate there [m/s or rad/s].
  double soft_at(const IslandModel& island, const Kinematics& kinematics, std::size_t soft,
                 double rate) const;
  /// C of coupled row c at a pose, with rates as of the last velocities.
  double coupling_error(const IslandModel& island, const Kinematics& kinematics,
                        const IntervalInputs& inputs, std::size_t c) const;
  /// Largest noted position of a coupled coordinate, by its share in the row [m].
  double largest_coupled(const IslandModel& island) const;
  /// Writes the noted positions of the coordinates of a general joint, laid out as
  /// JointStep::counted. Returns false where there is none.
  bool read(const IslandModel& island, std::size_t l,
            std::array<double, kMaxCoordinates>* positions) const;

 private:
  struct Noted {
    double position = 0.0, rate = 0.0;  // [m or rad], [m/s or rad/s]
  };
  struct Coupled {
    std::array<Noted, 2> terms;
    double constant = 0.0;
  };

  template <class Coordinate>
  double position_at(const Kinematics& kinematics, const Coordinate& coordinate, const Noted& noted,
                     double rate) const;

  List<Noted> softs_;       // per soft coordinate
  List<Coupled> coupled_;   // per coupled row
  TurnedAngles angles_;     // other angles; their time is that of all positions
  List<Noted> kept_softs_;  // saved by keep()
  List<Coupled> kept_coupled_;
};

}  // namespace constraint_sim::engine
