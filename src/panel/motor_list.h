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

/// A slider and a number for each motor of the world.
class MotorList : public QScrollArea {
 public:
  static constexpr std::size_t kMost = 50;  ///< motors with a slider, the first ones

  MotorList(Client& client, QWidget* parent);

  /// Asks the node which motors there are.
  void refresh();
  /// Asks again where the world has other constraints than before.
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
  std::vector<QSlider*> sliders_;  // of each motor
  std::vector<QDoubleSpinBox*> numbers_;
  ConstraintStatesConstPtr known_;
};

}  // namespace constraint_sim::panel
