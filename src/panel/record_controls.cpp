#include "panel/record_controls.h"

#include <QHBoxLayout>
#include <QLabel>
#include <stdexcept>
#include <utility>

#include "panel/widgets.h"

namespace constraint_sim::panel {

RecordControls::RecordControls(Client& client, Say say, QWidget* parent)
    : QWidget(parent), client_(client), say_(std::move(say)) {
  bag_ = named(new QLineEdit("constraint_sim", this), "Bag",
               "Path on this machine, to which the time and .bag are appended");
  button_ =
      make_button("Re&cord", "simulator_bag record, with edit_log", this, [this] { toggle(); });
  auto* const row = new QHBoxLayout(this);
  row->setContentsMargins(0, 0, 0, 0);
  row->addWidget(new QLabel("Bag", this));
  row->addWidget(bag_, 1);
  row->addWidget(button_);
}

void RecordControls::toggle() {
  if (recorder_.is_running()) {
    recorder_.stop();
    return;
  }
  try {
    recorder_.start(client_.node(), bag_path(bag_->text().toStdString()));
    button_->setText("Stop re&cording");
    say_(true, "recording " + QString::fromStdString(recorder_.path()));
  } catch (const std::runtime_error& error) {
    say_(false, QString("record: ") + error.what());
  }
}

void RecordControls::tick() {
  const auto ending = recorder_.take_ending();
  if (!ending) return;
  button_->setText("Re&cord");
  say_(ending->success, "record: " + QString::fromStdString(ending->message));
}

}  // namespace constraint_sim::panel
