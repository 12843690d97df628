#pragma once

#include <constraint_sim/ConstraintStates.h>

#include <QDoubleSpinBox>
#include <QLabel>
#include <QScrollArea>
#include <QSlider>
#include <vector>

#include "panel/client.h"
#include "panel/motors.h"

namespace constraint_sim::panel {

/// A slider and a number field for each motor of the world.
class MotorList : public QScrollArea {
 public:
  static constexpr std::size_t kMost = 50;  ///< number of motors with a slider, the first ones

  MotorList(Client& client, QWidget* parent);

  /// Requests the list of motors from the node.
  void refresh();
  /// Requests the list again where the world's constraints have changed.
  void follow(const ConstraintStatesConstPtr& constraints);

 private:
  void show_motors(const std::vector<Motor>& motors);
  void build_rows();
  void show_values(const std::vector<Motor>& motors);
  void add_row(int row, const Motor& motor);
  void move_slider(QSlider* slider, double value) const;
  void drive(const Motor& motor, double value);

  Client& client_;
  QWidget* rows_ = nullptr;
  QDoubleSpinBox* range_ = nullptr;
  double range_value_ = 1.0;
  std::vector<Motor> motors_;
  std::vector<QSlider*> sliders_;  // one for each motor
  std::vector<QDoubleSpinBox*> numbers_;
  ConstraintStatesConstPtr known_;
};

}  // namespace constraint_sim::panel
