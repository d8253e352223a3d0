// Receives the obstacle stream of the service: the newest frame, and its age.
#pragma once

#include <chrono>
#include <cstdint>
#include <deque>
#include <memory>
#include <optional>
#include <string>
#include <utility>

#include "osape_client/space.h"
#include "osape_v1.pb.h"

namespace osape_client {

// Age at which a message becomes stale. The service itself reports a camera as unavailable after 0.3 s.
constexpr double kTimeoutS = 0.4;

// Largest message that is received, in bytes. The sender of a larger one is disconnected, and no memory is taken for it.
constexpr std::int64_t kMostBytes = 16 << 20;

// The time since the start of this computer, including the time for which it was suspended: CLOCK_BOOTTIME on Linux.
// std::chrono::steady_clock stands still meanwhile, and old messages would count as new.
struct Clock {
  using duration = std::chrono::nanoseconds;
  using rep = duration::rep;
  using period = duration::period;
  using time_point = std::chrono::time_point<Clock>;
  static constexpr bool is_steady = true;
  static time_point now() noexcept;
};

// Finds messages that were longer on the way than the fastest one, as in a slow network or after it was interrupted. The clocks of
// two computers need not agree: the least difference between receipt and sending is that of the fastest message.
class Delays {
 public:
  // Time for which a message that was received now was longer on the way than the fastest one, in seconds.
  double late_s(const osape::v1::PrismsFrame& frame);

 private:
  std::string boot_;
  std::optional<double> least_s_;
  double at_s_ = 0.0;
};

// One frame. Nothing may be taken as free while stale() is true or content.valid() is false.
struct Message {
  osape::v1::PrismsFrame content;
  Clock::time_point received;  // the earliest time at which it can have arrived, with the least delay
  double timeout_s = kTimeoutS;

  // Upper bound of the present age of the exposure, in seconds. On another machine it lacks the least time on the network.
  double age_s() const;
  bool stale() const { return !(age_s() <= timeout_s); }
};

// Occupancy of the way of a ball as in space.h, but nothing is free or open while the message is stale.
inline Occupancy segment_occupancy(const Message& message, const Point& from, const Point& to, double radius_m, bool allow_open = false) {
  const Occupancy found = segment_occupancy(message.content, from, to, radius_m, allow_open);
  return message.stale() && found != Occupancy::kOccupied ? Occupancy::kUnknown : found;
}

// The same of a ball that does not move.
inline Occupancy occupancy(const Message& message, const Point& p, double radius_m, bool allow_open = false) {
  return segment_occupancy(message, p, p, radius_m, allow_open);
}

// Position of the vehicle at the exposure, in the message's frame: the origin in "level". None: the message does not contain it.
inline std::optional<Point> vehicle(const osape::v1::PrismsFrame& frame) {
  if (frame.frame() == "level") return Point{0.0, 0.0, 0.0};
  if (frame.frame() != "ned" || !frame.valid() || !frame.has_pose()) return std::nullopt;
  const auto& at = frame.pose().position_ned_m();
  return Point{at.x(), at.y(), at.z()};
}

// Refuses the frames of two services that reach one client, as through a proxy: the free space of one vehicle is none of another. A
// service that starts again takes the place of the one before it. If the one before goes on sending, there are two, and nothing of
// either is used until only one has been heard for kConflict.
class Sources {
 public:
  static constexpr std::chrono::seconds kConflict{10};
  // kLate: it waited while its service was replaced; kConflict: two services publish to this address.
  enum class Verdict { kUsed, kLate, kConflict };
  Verdict take(const Message& message);

 private:
  using Source = std::pair<std::string, std::uint64_t>;
  std::optional<Source> present_;
  double since_s_ = 0.0;  // when the first message of the present one was sent
  std::deque<Source> former_;
  std::optional<Clock::time_point> conflict_;
};

// Counts of received messages. undecodable: not a frame of this schema version; out_of_order: not newer than an earlier one;
// conflicting: not used because two services publish to the address; last_error: the cause of the last undecodable or conflicting
// one.
struct ReceiveStats {
  std::int64_t messages = 0;
  std::int64_t undecodable = 0;
  std::int64_t out_of_order = 0;
  std::int64_t conflicting = 0;
  std::string last_error;
};

// Keeps the newest message only: of several cameras that of whichever was published last. It connects again by itself when the
// service is restarted. Not thread-safe.
class Subscriber {
 public:
  // address: ipc:///run/osape-companion/prisms or tcp://HOST:PORT, IPv6 as tcp://[::1]:PORT. Throws std::runtime_error for an address that ZeroMQ refuses.
  explicit Subscriber(const std::string& address, double timeout_s = kTimeoutS);
  ~Subscriber();
  Subscriber(const Subscriber&) = delete;
  Subscriber& operator=(const Subscriber&) = delete;

  // The next message; nullptr when none comes within the timeout, a year at most. Valid until the next call.
  const Message* wait(std::chrono::milliseconds timeout);
  // The newest message without waiting; nullptr before the first. Check stale(): it may be an old one.
  const Message* latest();
  const ReceiveStats& stats() const { return stats_; }

 private:
  struct Socket;
  bool receive(std::chrono::milliseconds timeout);
  bool is_empty();
  void connect_after_silence();
  bool is_newer(const osape::v1::PrismsFrame& frame) const;
  void refuse_all();

  std::string address_;
  double timeout_s_;
  std::unique_ptr<Socket> socket_;
  Clock::time_point empty_;  // when the socket was last seen empty
  Clock::time_point heard_;  // when the last message was received, or the socket was connected again
  Delays delays_;
  Sources sources_;
  std::optional<Message> newest_;
  ReceiveStats stats_;
};

}  // namespace osape_client
