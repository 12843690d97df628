#include "panel/world_model.h"

#include <QColor>
#include <cmath>

namespace constraint_sim::panel {
namespace {

// Error that nothing is closing beyond which a constraint is red, equal to kToldError of the labels
// in rviz [m or rad].
constexpr double kLargeError = 1e-4;

/// Returns the number; nothing for a figure that does not exist.
QString number(double value) {
  return std::isnan(value) ? QString() : QString::number(value, 'g', 4);
}

QString state_of(const ConstraintState& constraint) {
  QString text = QString::fromStdString(constraint.type);
  if (constraint.broken) text += ", broken";
  if (constraint.closing) text += ", closing";
  if (constraint.saturated) text += ", at its limit";
  return text;
}

}  // namespace

int WorldModel::rows(int branch) const {
  if (branch == kBodies) return bodies_ ? static_cast<int>(bodies_->bodies.size()) : 0;
  return constraints_ ? static_cast<int>(constraints_->constraints.size()) : 0;
}

// Changes the messages. Rows are added and removed at the end, and all others change, so that the
// view keeps open branches and its position.
template <class Change>
void WorldModel::update(int branch, int count, Change change) {
  const QModelIndex parent = createIndex(branch, 0, kBranch);
  const int before = rows(branch);
  if (count > before) {
    beginInsertRows(parent, before, count - 1);
    change();
    endInsertRows();
  } else if (count < before) {
    beginRemoveRows(parent, count, before - 1);
    change();
    endRemoveRows();
  } else {
    change();
  }
  if (count > 0) Q_EMIT dataChanged(index(0, 0, parent), index(count - 1, kColumns - 1, parent));
  if (count != before) Q_EMIT dataChanged(parent, createIndex(branch, kColumns - 1, kBranch));
}

void WorldModel::set_bodies(const BodyStatesConstPtr& bodies) {
  update(kBodies, bodies ? static_cast<int>(bodies->bodies.size()) : 0, [&] { bodies_ = bodies; });
}

void WorldModel::set_constraints(const ConstraintStatesConstPtr& constraints) {
  update(kConstraints, constraints ? static_cast<int>(constraints->constraints.size()) : 0,
         [&] { constraints_ = constraints; });
}

QModelIndex WorldModel::index(int row, int column, const QModelIndex& parent) const {
  if (row < 0 || column < 0 || column >= kColumns || row >= rowCount(parent)) return {};
  return createIndex(row, column, parent.isValid() ? static_cast<quintptr>(parent.row()) : kBranch);
}

QModelIndex WorldModel::parent(const QModelIndex& index) const {
  if (!index.isValid() || index.internalId() == kBranch) return {};
  return createIndex(static_cast<int>(index.internalId()), 0, kBranch);
}

int WorldModel::rowCount(const QModelIndex& parent) const {
  if (!parent.isValid()) return kBranches;
  return parent.internalId() == kBranch && parent.column() == 0 ? rows(parent.row()) : 0;
}

int WorldModel::columnCount(const QModelIndex&) const { return kColumns; }

QVariant WorldModel::branch_text(int branch, int column) const {
  if (column == kName) return branch == kBodies ? "bodies" : "constraints";
  if (column == kState) return rows(branch);
  return {};
}

QVariant WorldModel::body_text(int row, int column) const {
  const BodyState& body = bodies_->bodies[static_cast<std::size_t>(row)];
  const auto& p = body.pose.position;
  const auto& v = body.twist.linear;
  switch (column) {
    case kName:
      return QString::fromStdString(body.name);
    case kState:
      return number(p.x) + "  " + number(p.y) + "  " + number(p.z);
    case kRate:
      return number(std::sqrt(v.x * v.x + v.y * v.y + v.z * v.z));
    default:
      return {};
  }
}

QVariant WorldModel::constraint_text(int row, int column) const {
  const ConstraintState& constraint = constraints_->constraints[static_cast<std::size_t>(row)];
  switch (column) {
    case kName:
      return QString::fromStdString(constraint.name);
    case kState:
      return state_of(constraint);
    case kError:
      return number(constraint.closing ? constraint.closing_error : constraint.error);
    case kForce:
      return number(constraint.force);
    case kRate:
      return number(constraint.reached_rate);
    default:
      return {};
  }
}

QVariant WorldModel::constraint_color(int row) const {
  const ConstraintState& constraint = constraints_->constraints[static_cast<std::size_t>(row)];
  if (constraint.broken) return QColor(Qt::gray);
  if (std::abs(constraint.error) > kLargeError) return QColor(Qt::red);
  return {};
}

QVariant WorldModel::data(const QModelIndex& index, int role) const {
  if (!index.isValid()) return {};
  const bool is_branch = index.internalId() == kBranch;
  if (!is_branch && index.row() >= rows(static_cast<int>(index.internalId()))) return {};
  const bool is_body = index.internalId() == kBodies;
  if (role == Qt::DisplayRole) {
    if (is_branch) return branch_text(index.row(), index.column());
    return is_body ? body_text(index.row(), index.column())
                   : constraint_text(index.row(), index.column());
  }
  if (role == Qt::ForegroundRole && !is_branch && !is_body) return constraint_color(index.row());
  return {};
}

QVariant WorldModel::headerData(int section, Qt::Orientation orientation, int role) const {
  static constexpr const char* kTitles[kColumns] = {"Name", "State", "Error", "Force", "Rate"};
  static constexpr const char* kTips[kColumns] = {
      "", "Position of a body [m], type of a constraint",
      "Value that the constraint keeps at zero; empty for a spring [m or rad]",
      "Mean over the last tick; below zero it pulls [N or N m]",
      "Speed of a body [m/s], rate that a constraint has reached [m/s or rad/s]"};
  if (orientation != Qt::Horizontal || section < 0 || section >= kColumns) return {};
  if (role == Qt::DisplayRole) return kTitles[section];
  if (role == Qt::ToolTipRole) return kTips[section];
  return {};
}

}  // namespace constraint_sim::panel
