#include "panel/motor_list.h"

#include <constraint_sim/SaveScene.h>
#include <constraint_sim/SetConstraintProperties.h>

#include <QGridLayout>
#include <QSignalBlocker>
#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "panel/widgets.h"

namespace constraint_sim::panel {
namespace {

constexpr int kTicks = 1000;  // positions of a slider on either side of 0

bool same_names(const ConstraintStates& a, const ConstraintStates& b) {
  return std::equal(a.constraints.begin(), a.constraints.end(), b.constraints.begin(),
                    b.constraints.end(),
                    [](const auto& one, const auto& other) { return one.name == other.name; });
}

}  // namespace

MotorList::MotorList(Client& client, QWidget* parent) : QScrollArea(parent), client_(client) {
  setWidgetResizable(true);
  build_rows();
}

void MotorList::follow(const ConstraintStatesConstPtr& constraints) {
  if (known_ && same_names(*known_, *constraints)) return;
  known_ = constraints;
  refresh();
}

// Reads the motors' settings from the saved scene: no topic has them.
void MotorList::refresh() {
  client_.poll<SaveScene>("save_scene", SaveSceneRequest(), [this](const auto& response) {
    try {
      show_motors(motors_in(response.text, kMost));
    } catch (const std::exception&) {
      show_motors({});
    }
  });
}

// Shows the motors. Rows are kept while the motors are the same: one may be under the mouse.
void MotorList::show_motors(const std::vector<Motor>& motors) {
  const bool are_same =
      std::equal(motors.begin(), motors.end(), motors_.begin(), motors_.end(), same_motor);
  motors_ = motors;
  if (!are_same) build_rows();
  show_values(motors);
}

void MotorList::show_values(const std::vector<Motor>& motors) {
  for (std::size_t i = 0; i < motors.size(); ++i) {
    if (sliders_[i]->isSliderDown() || numbers_[i]->hasFocus()) continue;
    const QSignalBlocker blocked(numbers_[i]);
    numbers_[i]->setValue(motors[i].value);
    move_slider(sliders_[i], motors[i].value);
  }
}

void MotorList::build_rows() {
  sliders_.clear();
  numbers_.clear();
  rows_ = new QWidget(this);
  auto* const grid = new QGridLayout(rows_);
  grid->setColumnStretch(1, 1);
  range_ = named(new QDoubleSpinBox(rows_), "Motor range", "What sliders reach to either side");
  range_->setRange(1e-3, 1e6);
  range_->setDecimals(3);
  range_->setValue(range_value_);
  connect(range_, QOverload<double>::of(&QDoubleSpinBox::valueChanged), [this](double value) {
    range_value_ = value;
    for (std::size_t i = 0; i < sliders_.size(); ++i)
      move_slider(sliders_[i], numbers_[i]->value());
  });
  grid->addWidget(new QLabel("Range", rows_), 0, 0);
  grid->addWidget(range_, 0, 2);
  for (std::size_t i = 0; i < motors_.size(); ++i) add_row(static_cast<int>(i) + 1, motors_[i]);
  if (motors_.empty()) grid->addWidget(new QLabel("no motor", rows_), 1, 0);
  if (motors_.size() == kMost)
    grid->addWidget(new QLabel(QStringLiteral("the first %1").arg(kMost), rows_), kMost + 1, 0);
  grid->setRowStretch(static_cast<int>(kMost) + 2, 1);
  setWidget(rows_);  // deletes the previous rows
}

void MotorList::move_slider(QSlider* slider, double value) const {
  const QSignalBlocker blocked(slider);
  slider->setValue(
      static_cast<int>(std::lround(kTicks * std::clamp(value / range_value_, -1.0, 1.0))));
}

void MotorList::add_row(int row, const Motor& motor) {
  const QString name = QString::fromStdString(motor.constraint);
  const QString tip =
      QStringLiteral("%1 [%2]").arg(QString::fromStdString(motor.key), unit_of(motor.key));
  auto* const slider = named(new QSlider(Qt::Horizontal, rows_), "Motor slider " + name, tip);
  auto* const number = named(new QDoubleSpinBox(rows_), "Motor " + name, tip);
  slider->setRange(-kTicks, kTicks);
  number->setRange(-1e6, 1e6);
  number->setDecimals(4);
  number->setKeyboardTracking(false);
  number->setValue(motor.value);
  move_slider(slider, motor.value);
  connect(slider, &QSlider::valueChanged,
          [this, number](int value) { number->setValue(range_value_ * value / kTicks); });
  connect(number, QOverload<double>::of(&QDoubleSpinBox::valueChanged),
          [this, motor, slider](double value) {
            if (!slider->isSliderDown()) move_slider(slider, value);
            drive(motor, value);
          });
  sliders_.push_back(slider);
  numbers_.push_back(number);
  auto* const grid = static_cast<QGridLayout*>(rows_->layout());
  grid->addWidget(new QLabel(name, rows_), row, 0);
  grid->addWidget(slider, row, 1);
  grid->addWidget(number, row, 2);
}

// Sets a motor. Uses set_constraint_properties, since set_motor_bias would need max_force too.
void MotorList::drive(const Motor& motor, double value) {
  SetConstraintPropertiesRequest request;
  request.name = motor.constraint;
  request.keys = {motor.key};
  request.values = {value};
  client_.call<SetConstraintProperties>(
      Queue::kEdits, "set_constraint_properties",
      motor.constraint + " " + motor.key + " " + QString::number(value).toStdString(), request,
      nullptr, "motor " + motor.constraint);
}

}  // namespace constraint_sim::panel
