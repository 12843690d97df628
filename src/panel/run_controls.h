#pragma once

#include <QDoubleSpinBox>
#include <QSpinBox>
#include <QWidget>

#include "panel/client.h"

namespace constraint_sim::panel {

/// Buttons for play, pause, steps and resets, and the real-time factor.
class RunControls : public QWidget {
 public:
  RunControls(Client& client, QWidget* parent);

  /// Shows the node's real-time factor.
  void show_real_time_factor(double factor);

 private:
  void step();
  void set_real_time_factor();
  void call_empty(Queue queue, const char* service);

  Client& client_;
  QSpinBox* steps_;
  QDoubleSpinBox* real_time_factor_;
  double last_factor_ = 1.0;
};

}  // namespace constraint_sim::panel
