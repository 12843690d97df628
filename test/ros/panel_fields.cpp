// Shows the panel as rviz loads it, on no display, and prints name and text of each of its text
// fields whenever the text changes, separated by a tabulator.

#include <ros/init.h>
#include <ros/node_handle.h>
#include <rviz/panel.h>

#include <QApplication>
#include <QLineEdit>
#include <QTimer>
#include <iostream>
#include <map>
#include <memory>
#include <pluginlib/class_loader.hpp>

int main(int argc, char** argv) {
  constexpr int kPeriod = 50;  // period of looking at the fields and for the end [ms]
  ros::init(argc, argv, "panel_fields");
  const ros::NodeHandle node;
  qputenv("QT_QPA_PLATFORM", "offscreen");
  const QApplication application(argc, argv);
  pluginlib::ClassLoader<rviz::Panel> loader("rviz", "rviz::Panel");
  const std::unique_ptr<rviz::Panel> panel(
      loader.createUnmanagedInstance("constraint_sim/Simulator"));
  panel->initialize(nullptr);
  panel->show();

  std::map<QString, QString> shown;
  QTimer timer;
  QObject::connect(&timer, &QTimer::timeout, [&] {
    if (!ros::ok()) QApplication::quit();
    for (const QLineEdit* const field : panel->findChildren<QLineEdit*>()) {
      const QString name = field->accessibleName(), text = field->text();
      const auto [entry, is_new] = shown.try_emplace(name, text);
      if (!is_new && entry->second == text) continue;
      entry->second = text;
      std::cout << name.toStdString() << '\t' << text.toStdString() << std::endl;
    }
  });
  timer.start(kPeriod);
  return QApplication::exec();
}
