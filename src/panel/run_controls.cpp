#include "panel/run_controls.h"

#include <constraint_sim/SetOptions.h>
#include <constraint_sim/Step.h>
#include <std_srvs/Empty.h>

#include <QGridLayout>
#include <QLabel>

#include "panel/widgets.h"

namespace constraint_sim::panel {

RunControls::RunControls(Client& client, QWidget* parent) : QWidget(parent), client_(client) {
  steps_ = named(new QSpinBox(this), "Number of steps", "Ticks that Step does");
  steps_->setRange(1, 1000000);
  real_time_factor_ = named(new QDoubleSpinBox(this), "Real-time factor",
                            "Simulated seconds per second; 0: as fast as it can");
  real_time_factor_->setDecimals(3);
  real_time_factor_->setRange(0.0, 1000.0);
  real_time_factor_->setValue(last_factor_);
  connect(real_time_factor_, &QDoubleSpinBox::editingFinished, [this] { set_real_time_factor(); });

  auto* const grid = new QGridLayout(this);
  grid->setContentsMargins(0, 0, 0, 0);
  grid->addWidget(make_button("P&lay", "unpause_physics", this,
                              [this] { call_empty(Queue::kPauses, "unpause_physics"); }),
                  0, 0);
  grid->addWidget(make_button("Pa&use", "pause_physics", this,
                              [this] { call_empty(Queue::kPauses, "pause_physics"); }),
                  0, 1);
  grid->addWidget(make_button("&Step", "step", this, [this] { step(); }), 0, 2);
  grid->addWidget(steps_, 0, 3);
  grid->addWidget(make_button("Reset &world", "reset_world: time goes on", this,
                              [this] { call_empty(Queue::kEdits, "reset_world"); }),
                  1, 0);
  grid->addWidget(make_button("Reset &all", "reset_simulation: time 0 as well", this,
                              [this] { call_empty(Queue::kEdits, "reset_simulation"); }),
                  1, 1);
  grid->addWidget(new QLabel("Speed", this), 1, 2, Qt::AlignRight);
  grid->addWidget(real_time_factor_, 1, 3);
}

void RunControls::call_empty(Queue queue, const char* service) {
  client_.call<std_srvs::Empty>(queue, service, "", std_srvs::EmptyRequest());
}

void RunControls::step() {
  StepRequest request;
  request.steps = static_cast<std::uint32_t>(steps_->value());
  client_.call<Step>(Queue::kSteps, "step", std::to_string(request.steps), request);
}

void RunControls::show_real_time_factor(double factor) {
  last_factor_ = factor;
  if (!real_time_factor_->hasFocus()) real_time_factor_->setValue(factor);
}

// Sends the factor if it changed: editingFinished also comes when the focus is lost.
void RunControls::set_real_time_factor() {
  const double factor = real_time_factor_->value();
  if (factor == last_factor_) return;
  last_factor_ = factor;
  SetOptionsRequest request;
  const std::string text = QString::number(factor).toStdString();
  request.keys = {"real_time_factor"};
  request.values = {text};
  client_.call<SetOptions>(Queue::kEdits, "set_options", "real_time_factor " + text, request,
                           nullptr, "real_time_factor");
}

}  // namespace constraint_sim::panel
