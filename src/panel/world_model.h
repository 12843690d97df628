#pragma once

#include <constraint_sim/BodyStates.h>
#include <constraint_sim/ConstraintStates.h>

#include <QAbstractItemModel>

namespace constraint_sim::panel {

/// Bodies and constraints as a tree of two branches. Reads the messages directly: a row costs
/// nothing until it is drawn.
class WorldModel : public QAbstractItemModel {
 public:
  enum Column { kName, kState, kError, kForce, kRate, kColumns };

  using QAbstractItemModel::QAbstractItemModel;

  void set_bodies(const BodyStatesConstPtr& bodies);
  void set_constraints(const ConstraintStatesConstPtr& constraints);

  QModelIndex index(int row, int column, const QModelIndex& parent) const override;
  QModelIndex parent(const QModelIndex& index) const override;
  int rowCount(const QModelIndex& parent) const override;
  int columnCount(const QModelIndex& parent) const override;
  QVariant data(const QModelIndex& index, int role) const override;
  QVariant headerData(int section, Qt::Orientation orientation, int role) const override;

 private:
  enum Branch { kBodies, kConstraints, kBranches };
  // Value of internalId(): kBranch for branches, the branch's number for rows.
  static constexpr quintptr kBranch = kBranches;

  int rows(int branch) const;
  QVariant branch_text(int branch, int column) const;
  QVariant body_text(int row, int column) const;
  QVariant constraint_text(int row, int column) const;
  QVariant constraint_color(int row) const;
  template <class Change>
  void update(int branch, int count, Change change);

  BodyStatesConstPtr bodies_;
  ConstraintStatesConstPtr constraints_;
};

}  // namespace constraint_sim::panel
