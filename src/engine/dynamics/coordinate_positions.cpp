#include "engine/dynamics/coordinate_positions.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "engine/dynamics/kinematics.h"

namespace constraint_sim::engine {
namespace {

/// Lists the angles of general joints that neither a soft coordinate nor a coupling reads.
TurnedAngles unread_angles(const IslandModel& island) {
  TurnedAngles angles;
  for (std::size_t l = 0; l < island.links().size(); ++l) {
    const IslandModel::Link& link = island.links()[l];
    const JointForms& kind = forms(link.kind);
    for (int i = 0; island.is_general(l) && i < kind.coordinates; ++i) {
      const auto is_read_by = [&](const IslandModel::CoupledRow& coupled) {
        return std::any_of(coupled.terms.begin(), coupled.terms.end(), [&](const auto& term) {
          return term.link == l && term.coordinate == i;
        });
      };
      bool is_read =
          std::any_of(island.coupled_rows().begin(), island.coupled_rows().end(), is_read_by);
      for (std::size_t s = link.first_soft; s < link.first_soft + link.softs; ++s)
        is_read = is_read || island.soft_coordinates()[s].function == kind.rows + i;
      if (kind.coordinate[to_index(i)].is_angle && !is_read)
        angles.add(l, link.kind, i, link.a, link.b);
    }
  }
  return angles;
}

}  // namespace

CoordinatePositions::CoordinatePositions(const IslandModel& island)
    : angles_(unread_angles(island)) {
  for (auto* list : {&softs_, &kept_softs_}) list->resize(island.soft_coordinates().size());
  for (auto* list : {&coupled_, &kept_coupled_}) list->resize(island.coupled_rows().size());
}

void CoordinatePositions::begin_step(const IslandModel& island, const List<JointData>& states) {
  const auto noted = [&](std::size_t l, int coordinate) -> Noted {
    const CoordinateState& state = states[island.joints()[l]].coordinates[to_index(coordinate)];
    return {state.position, state.velocity};
  };
  for (std::size_t s = 0; s < softs_.size(); ++s) {
    const IslandModel::SoftCoordinate& soft = island.soft_coordinates()[s];
    softs_[s] = noted(soft.link, soft.function - forms(island.links()[soft.link].kind).rows);
  }
  for (std::size_t c = 0; c < coupled_.size(); ++c) {
    const IslandModel::CoupledRow& row = island.coupled_rows()[c];
    coupled_[c].constant = states[island.joints()[row.link]].coupling.constant;
    for (std::size_t k = 0; k < 2; ++k)
      coupled_[c].terms[k] = noted(row.terms[k].link, row.terms[k].coordinate);
  }
  angles_.begin(
      [&](std::size_t l) -> const JointData& { return states[to_index(island.joints()[l])]; });
}

template <class Coordinate>
double CoordinatePositions::position_at(const Kinematics& kinematics, const Coordinate& coordinate,
                                        const Noted& noted, double rate) const {
  const double there = value(coordinate.form, kinematics.vectors(coordinate.link));
  return reading(coordinate.form, there, coordinate.zero,
                 integrated(noted.position, kinematics.time() - angles_.time(), noted.rate, rate));
}

double CoordinatePositions::soft_at(const IslandModel& island, const Kinematics& kinematics,
                                    std::size_t soft, double rate) const {
  return position_at(kinematics, island.soft_coordinates()[soft], softs_[soft], rate);
}

double CoordinatePositions::coupling_error(const IslandModel& island, const Kinematics& kinematics,
                                           const IntervalInputs& inputs, std::size_t c) const {
  double sum = 0.0;
  for (std::size_t k = 0; k < 2; ++k) {
    const IslandModel::CoupledRow::Term& term = island.coupled_rows()[c].terms[k];
    sum += term.ratio * position_at(kinematics, term, coupled_[c].terms[k],
                                    kinematics.rate_of(term.link, term.form));
  }
  return sum - coupled_[c].constant - inputs.coupling_offset(c).value;
}

void CoordinatePositions::note(const IslandModel& island, const IntervalInputs& inputs,
                               const Kinematics& kinematics) {
  const auto note = [&](const auto& coordinate, Noted* noted) {
    const double rate = kinematics.rate_of(coordinate.link, coordinate.form);
    *noted = {position_at(kinematics, coordinate, *noted, rate), rate};
  };
  for (std::size_t s = 0; s < softs_.size(); ++s) note(island.soft_coordinates()[s], &softs_[s]);
  for (std::size_t c = 0; c < coupled_.size(); ++c)
    for (std::size_t k = 0; k < 2; ++k)
      note(island.coupled_rows()[c].terms[k], &coupled_[c].terms[k]);
  note_angles(
      kinematics.time(), [&](std::size_t point) { return kinematics.spin(island, inputs, point); },
      [&](const TurnedAngles::Angle& angle) {
        const JointVectors& vectors = kinematics.vectors(angle.joint);
        return (angle.is_about_b ? vectors.axes_B : vectors.axes_A).col(2);
      });
}

void CoordinatePositions::keep() {
  kept_softs_ = softs_;
  kept_coupled_ = coupled_;
  angles_.keep();
}

void CoordinatePositions::restore() {
  softs_ = kept_softs_;
  coupled_ = kept_coupled_;
  angles_.restore();
}

double CoordinatePositions::largest_coupled(const IslandModel& island) const {
  double largest = 0.0;
  for (std::size_t c = 0; c < coupled_.size(); ++c) {
    const IslandModel::CoupledRow& row = island.coupled_rows()[c];
    for (std::size_t k = 0; k < 2; ++k)
      largest = std::max(largest, row.metres * std::abs(row.terms[k].ratio * term(c, k)));
  }
  return largest;
}

bool CoordinatePositions::read(const IslandModel& island, std::size_t l,
                               std::array<double, kMaxCoordinates>* positions) const {
  const IslandModel::Link& link = island.links()[l];
  if (!island.is_general(l) || (link.softs == 0 && coupled_.empty() && angles_.empty()))
    return false;
  positions->fill(std::numeric_limits<double>::quiet_NaN());
  for (std::size_t s = link.first_soft; s < link.first_soft + link.softs; ++s)
    (*positions)[to_index(island.soft_coordinates()[s].function - forms(link.kind).rows)] = soft(s);
  for (std::size_t c = 0; c < coupled_.size(); ++c)
    for (std::size_t k = 0; k < 2; ++k)
      if (island.coupled_rows()[c].terms[k].link == l)
        (*positions)[to_index(island.coupled_rows()[c].terms[k].coordinate)] = term(c, k);
  angles_.read(l, positions);
  return true;
}

}  // namespace constraint_sim::engine
