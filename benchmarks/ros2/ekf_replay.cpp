// Gives recorded messages to the filter of robot_localization, and prints what it estimates.
//
//   ekf_replay PARAMETERS [FIRST_S DELAY_S] < messages
//
// PARAMETERS is a parameter file of ekf_node, read by the parser of ROS. A parameter of another type than in
// the node, or that the node does not have, is an error. A message is a line of words, the numbers of a
// covariance by rows as in ROS:
//
//   odom TOPIC STAMP_NS FRAME CHILD_FRAME x y yaw 36 numbers vx vy yaw_rate 36 numbers
//   pose TOPIC STAMP_NS FRAME FRAME x y yaw 36 numbers
//
// Each message is filtered when it comes. With the times the timer of the node runs at `frequency`, FIRST_S
// after the first stamp at first, and a message comes DELAY_S after its stamp. After each update a line is
// printed: time in ns, 15 states, and their covariance by rows.
//
// Build it with src/ekf.cpp, src/filter_base.cpp and src/filter_utilities.cpp of robot_localization, Eigen,
// angles, rclcpp and rcl_yaml_param_parser.

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <iostream>
#include <limits>
#include <map>
#include <queue>
#include <set>
#include <sstream>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include <rcl_yaml_param_parser/parser.h>
#include <robot_localization/ekf.hpp>

namespace rl = robot_localization;

namespace
{
using Error = std::runtime_error;
constexpr int kStates = rl::STATE_SIZE;
constexpr int kSix = 6;

rclcpp::Time at(int64_t time_ns) {return rclcpp::Time(time_ns, RCL_ROS_TIME);}

// Parameters of ekf_node with their types.
class Parameters
{
public:
  explicit Parameters(const std::string & path)
  {
    auto * all = rcl_yaml_node_struct_init(rcutils_get_default_allocator());
    if (!rcl_parse_yaml_file(path.c_str(), all)) {
      throw Error(std::string("the parser of ROS: ") + rcutils_get_error_string().str);
    }
    for (size_t node = 0; node < all->num_nodes; ++node) {
      const auto & given = all->params[node];
      if (std::string(all->node_names[node]) != "ekf_filter_node") {continue;}
      for (size_t n = 0; n < given.num_params; ++n) {
        values_[given.parameter_names[n]] = given.parameter_values[n];
      }
    }
    if (values_.empty()) {throw Error("no parameter of ekf_filter_node");}
  }

  bool flag(const std::string & name, bool otherwise)
  {
    const auto * value = find(name);
    return value ? *typed(value->bool_value, name) : otherwise;
  }
  double number(const std::string & name, double otherwise)
  {
    const auto * value = find(name);
    return value ? *typed(value->double_value, name) : otherwise;
  }
  std::string text(const std::string & name, const std::string & otherwise)
  {
    const auto * value = find(name);
    return value ? typed(value->string_value, name) : otherwise;
  }
  std::vector<bool> flags(const std::string & name)
  {
    const auto * value = find(name);
    if (!value) {return std::vector<bool>(kStates, false);}
    const auto & array = *typed(value->bool_array_value, name);
    if (array.size != kStates) {throw Error(name + " has not 15 values");}
    return std::vector<bool>(array.values, array.values + array.size);
  }
  bool matrix(const std::string & name, Eigen::MatrixXd & matrix)
  {
    const auto * value = find(name);
    if (!value) {return false;}
    const auto & array = *typed(value->double_array_value, name);
    if (array.size != kStates * kStates) {throw Error(name + " has not 225 values");}
    matrix = Eigen::Map<Eigen::MatrixXd>(array.values, kStates, kStates).transpose();
    return true;
  }
  void check_all_read() const
  {
    for (const auto & each : values_) {
      if (!read_.count(each.first)) {throw Error("ekf_node has no parameter " + each.first);}
    }
  }

private:
  const rcl_variant_t * find(const std::string & name)
  {
    read_.insert(name);
    const auto found = values_.find(name);
    return found == values_.end() ? nullptr : &found->second;
  }
  template<typename T>
  static T * typed(T * value, const std::string & name)
  {
    if (!value) {throw Error(name + " has another type");}
    return value;
  }

  std::map<std::string, rcl_variant_t> values_;
  std::set<std::string> read_;
};

struct Later
{
  bool operator()(const rl::Measurement & a, const rl::Measurement & b) const {return a.time_ > b.time_;}
};

class Node
{
public:
  explicit Node(const std::string & path)
  {
    Parameters given(path);
    const auto map = given.text("map_frame", "map"), odom = given.text("odom_frame", "odom");
    base_ = given.text("base_link_frame", "base_link");
    world_ = given.text("world_frame", odom);
    if (map == odom || odom == base_ || map == base_) {throw Error("two frames are the same");}
    if (world_ != odom && world_ != map) {throw Error("world_frame is neither map nor odom");}
    given.flag("publish_tf", true);
    frequency = given.number("frequency", 30.0);
    filter_.setSensorTimeout(rclcpp::Duration::from_seconds(given.number("sensor_timeout", 1.0 / frequency)));
    is_plane_ = given.flag("two_d_mode", false);
    for (const char * kind : {"odom", "pose"}) {
      for (int n = 0; load(given, kind + std::to_string(n)); ++n) {}
    }
    Eigen::MatrixXd matrix;
    if (given.matrix("process_noise_covariance", matrix)) {filter_.setProcessNoiseCovariance(matrix);}
    if (given.matrix("initial_estimate_covariance", matrix)) {filter_.setEstimateErrorCovariance(matrix);}
    given.check_all_read();
  }

  // Takes a message.
  void take(const std::string & line)
  {
    std::istringstream words(line);
    std::string kind, topic, frame, child;
    int64_t stamp_ns = 0;
    words >> kind >> topic >> stamp_ns >> frame >> child;
    const auto found = updates_.find(topic);
    if (found == updates_.end()) {return;}
    add(words, stamp_ns, found->second, 0, frame, world_);
    if (kind == "odom") {add(words, stamp_ns, found->second, kSix, child, base_);}
  }

  // Filters what was taken, at a time of the timer.
  void update(int64_t now_ns)
  {
    const auto now = at(now_ns);
    if (waiting_.empty() && filter_.getInitializedStatus()) {
      const auto passed = now - filter_.getLastMeasurementTime();
      if (passed >= filter_.getSensorTimeout()) {
        filter_.predict(now, passed);
        filter_.setLastMeasurementTime(now);
      }
    }
    for (; !waiting_.empty() && !(waiting_.top().time_ > now); waiting_.pop()) {
      filter_.processMeasurement(waiting_.top());
    }
    if (filter_.getInitializedStatus()) {print();}
  }

  double frequency;

private:
  bool load(Parameters & given, const std::string & name)
  {
    const auto topic = given.text(name, "");
    if (topic.empty()) {return false;}
    if (given.flag(name + "_differential", false) || given.flag(name + "_relative", false)) {
      throw Error(name + ": differential and relative poses are not known here");
    }
    updates_[topic] = given.flags(name + "_config");
    return true;
  }

  // Adds the pose, or the velocity, of a message.
  void add(
    std::istream & words, int64_t stamp_ns, const std::vector<bool> & update, int first,
    const std::string & frame, const std::string & wanted)
  {
    rl::Measurement made;
    made.time_ = at(stamp_ns);
    made.update_vector_ = std::vector<bool>(kStates, false);
    made.measurement_ = Eigen::VectorXd::Zero(kStates);
    made.covariance_ = Eigen::MatrixXd::Zero(kStates, kStates);
    for (int place : {0, 1, 5}) {words >> made.measurement_(first + place);}
    for (int n = 0; n < kSix * kSix; ++n) {words >> made.covariance_(first + n / kSix, first + n % kSix);}
    if (!words) {throw Error("a message is too short");}
    std::copy_n(update.begin() + first, kSix, made.update_vector_.begin() + first);
    if (!std::count(made.update_vector_.begin(), made.update_vector_.end(), true)) {return;}
    if (frame != wanted) {throw Error("needs the transform from " + frame + " to " + wanted);}
    if (is_plane_) {
      using namespace robot_localization;
      for (int state : {StateMemberZ, StateMemberRoll, StateMemberPitch, StateMemberVz, StateMemberVroll,
          StateMemberVpitch, StateMemberAz})
      {
        made.update_vector_[state] = true;
        made.measurement_(state) = 0.0;
        made.covariance_(state, state) = 1e-6;
      }
    }
    waiting_.push(made);
  }

  void print()
  {
    std::printf("%lld", static_cast<long long>(filter_.getLastMeasurementTime().nanoseconds()));
    for (int n = 0; n < kStates; ++n) {std::printf(" %.17g", filter_.getState()(n));}
    const auto & covariance = filter_.getEstimateErrorCovariance();
    for (int n = 0; n < kStates * kStates; ++n) {std::printf(" %.17g", covariance(n / kStates, n % kStates));}
    std::printf("\n");
  }

  rl::Ekf filter_;
  std::string base_, world_;
  bool is_plane_ = false;
  std::map<std::string, std::vector<bool>> updates_;
  std::priority_queue<rl::Measurement, std::vector<rl::Measurement>, Later> waiting_;
};

void run(int count, char ** words)
{
  Node node(words[1]);
  std::vector<std::pair<int64_t, std::string>> messages;
  for (std::string line, kind, topic; std::getline(std::cin, line); ) {
    int64_t stamp_ns = 0;
    std::istringstream(line) >> kind >> topic >> stamp_ns;
    messages.emplace_back(stamp_ns, line);
  }
  std::stable_sort(
    messages.begin(), messages.end(), [](const auto & a, const auto & b) {return a.first < b.first;});
  if (count == 2) {
    for (const auto & each : messages) {node.take(each.second); node.update(each.first);}
    return;
  }
  const double first_s = std::stod(words[2]), delay_s = std::stod(words[3]);
  size_t next = 0;
  for (int64_t tick = 0; next < messages.size(); ++tick) {
    const int64_t now_ns = messages[0].first + std::llround(1e9 * (first_s + tick / node.frequency));
    for (; next < messages.size() && messages[next].first + std::llround(1e9 * delay_s) <= now_ns; ++next) {
      node.take(messages[next].second);
    }
    node.update(now_ns);
  }
}
}  // namespace

int main(int count, char ** words)
{
  if (count != 2 && count != 4) {
    std::cerr << "usage: ekf_replay PARAMETERS [FIRST_S DELAY_S] < messages\n";
    return 2;
  }
  try {
    run(count, words);
  } catch (const std::exception & error) {
    std::cerr << "ekf_replay: " << error.what() << "\n";
    return 1;
  }
  return 0;
}
