#pragma once

#include <constraint_sim/ListSnapshots.h>

#include <QDoubleSpinBox>
#include <QLabel>
#include <QSlider>
#include <QWidget>
#include <chrono>

#include "panel/client.h"

namespace constraint_sim::panel {

/// Restores snapshots of the ring, and takes them regularly.
class SnapshotControls : public QWidget {
 public:
  SnapshotControls(Client& client, QWidget* parent);

  /// Requests the list of snapshots from the node.
  void refresh();
  /// Takes a snapshot when one is due.
  void tick(bool is_running);
  double interval() const { return interval_->value(); }
  void set_interval(double seconds) { interval_->setValue(seconds); }

 private:
  void keep(bool is_poll);
  void rewind();
  void show_list(const ListSnapshotsResponse& list);
  void show_chosen();

  Client& client_;
  QSlider* slider_;
  QLabel* chosen_;
  QDoubleSpinBox* interval_;
  ListSnapshotsResponse list_;  // oldest first
  std::chrono::steady_clock::time_point last_kept_;
};

}  // namespace constraint_sim::panel
