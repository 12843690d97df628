#pragma once

#include <QLineEdit>
#include <QPushButton>
#include <QWidget>
#include <functional>

#include "panel/client.h"
#include "panel/recorder.h"

namespace constraint_sim::panel {

/// Controls for recording a bag, which a separate process writes.
class RecordControls : public QWidget {
 public:
  using Say = std::function<void(bool success, const QString& message)>;

  RecordControls(Client& client, Say say, QWidget* parent);

  /// Checks whether the process has ended.
  void tick();
  QString bag() const { return bag_->text(); }
  void set_bag(const QString& prefix) { bag_->setText(prefix); }

 private:
  void toggle();

  Client& client_;
  Say say_;
  Recorder recorder_;
  QLineEdit* bag_;
  QPushButton* button_;
};

}  // namespace constraint_sim::panel
