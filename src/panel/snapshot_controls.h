#pragma once

#include <constraint_sim/ListSnapshots.h>

#include <QDoubleSpinBox>
#include <QLabel>
#include <QSlider>
#include <QWidget>
#include <chrono>

#include "panel/client.h"

namespace constraint_sim::panel {

/// Goes back to a snapshot of the ring, and fills the ring.
class SnapshotControls : public QWidget {
 public:
  SnapshotControls(Client& client, QWidget* parent);

  /// Asks the node for its snapshots.
  void refresh();
  /// Keeps a snapshot where one is due.
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
  ListSnapshotsResponse list_;  // the oldest first
  std::chrono::steady_clock::time_point last_kept_;
};

}  // namespace constraint_sim::panel
