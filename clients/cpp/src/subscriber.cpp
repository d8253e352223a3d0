#include "osape_client/subscriber.h"

#include <time.h>
#include <zmq.h>

#include <algorithm>
#include <fstream>
#include <limits>
#include <stdexcept>
#include <utility>

namespace osape_client {
namespace {

constexpr std::uint32_t kSchemaVersion = 1;
// Time without a message after which the socket connects again. ZeroMQ gives a connection up for good where the other side is no
// service, or sends a message that is too large; the service may have taken its place since.
constexpr auto kSilence = std::chrono::seconds(5);
// Largest difference in rate of the clocks of two computers, each corrected by up to 500 ppm. A delay that grows more slowly is not
// noticed, and one that lasts counts for less by as much.
constexpr double kClockDrift = 1e-3;
constexpr std::size_t kMostFormer = 16;  // services of which is remembered that others have replaced them
constexpr double kMostLateS = 1e9;  // longer than any; its nanoseconds fit into 64 bits
constexpr std::chrono::milliseconds kLongestWait = std::chrono::hours(24 * 365);  // the end of a longer one does not fit

double seconds(Clock::duration duration) { return std::chrono::duration<double>(duration).count(); }

// Sums of numbers of a message in floating point: those of a damaged one would overflow.
double seconds(std::int64_t nanoseconds) { return 1e-9 * static_cast<double>(nanoseconds); }

double now_s() { return seconds(Clock::now().time_since_epoch()); }


// The offsets of the time namespace of this process, as of a container, such as +0.0.100.0; empty: it has none.
std::string time_offsets() {
  std::ifstream file("/proc/self/timens_offsets");
  std::string found;
  bool shifted = false;
  for (std::string clock, seconds, nanoseconds; file >> clock >> seconds >> nanoseconds;) {
    shifted = shifted || seconds != "0" || nanoseconds != "0";
    found += (found.empty() ? "+" : ".") + seconds + "." + nanoseconds;
  }
  return shifted ? found : "";
}

// Identifier of this boot of the machine and of its time namespace; empty where the system has none.
const std::string& boot_id() {
  static const std::string id = [] {
    std::string line;
    std::ifstream file("/proc/sys/kernel/random/boot_id");
    std::getline(file, line);
    return line.empty() ? line : line + time_offsets();
  }();
  return id;
}

// Whether stamps of the service are by the clock of this machine.
bool has_this_clock(const osape::v1::Publication& publication) {
  return !boot_id().empty() && publication.boot_id() == boot_id() && publication.has_suspended_ns();
}

// The earliest time at which a message can have been sent, from another machine that at which it can have arrived.
double earliest_sent_s(const Message& message) {
  const auto& publication = message.content.publication();
  const double received_s = seconds(message.received.time_since_epoch());
  if (message.content.t_exposure_ns() == 0 || !has_this_clock(publication)) return received_s;
  const double sent_s = seconds(message.content.t_exposure_ns()) + seconds(publication.suspended_ns()) + seconds(publication.age_ns());
  return sent_s <= now_s() ? sent_s : received_s;
}

}  // namespace

Clock::time_point Clock::now() noexcept {
#ifdef CLOCK_BOOTTIME
  timespec now{};
  clock_gettime(CLOCK_BOOTTIME, &now);
  return time_point(std::chrono::seconds(now.tv_sec) + std::chrono::nanoseconds(now.tv_nsec));
#else
  return time_point(std::chrono::steady_clock::now().time_since_epoch());
#endif
}

double Delays::late_s(const osape::v1::PrismsFrame& frame) {
  const auto& publication = frame.publication();
  if (frame.t_exposure_ns() == 0) return 0.0;  // without an exposure
  const double now = now_s(), sent = seconds(frame.t_exposure_ns()) + seconds(publication.suspended_ns()) + seconds(publication.age_ns());
  const bool known = least_s_ && publication.boot_id() == boot_;
  least_s_ = known ? std::min(*least_s_ + kClockDrift * (now - at_s_), now - sent) : now - sent;
  boot_ = publication.boot_id();
  at_s_ = now;
  return std::min(now - sent - *least_s_, kMostLateS);
}

double Message::age_s() const {
  const auto& publication = content.publication();
  const double published_s = std::max(0.0, seconds(publication.age_ns()));
  const auto now = Clock::now();
  const double since_receipt_s = published_s + seconds(now - received);
  if (has_this_clock(publication)) {
    const double exposed_s = seconds(content.t_exposure_ns()) + seconds(publication.suspended_ns());
    const double since_s = seconds(now.time_since_epoch()) - exposed_s;
    // a negative age: the stamp was in the future when it was sent
    if (since_s >= 0.0) return std::max(since_s, publication.age_ns() >= 0 ? published_s : since_receipt_s);
  }
  return since_receipt_s;
}

Sources::Verdict Sources::take(const Message& message) {
  const auto& publication = message.content.publication();
  const Source source(publication.boot_id(), publication.start_ns());
  const auto now = Clock::now();
  if (source != present_) {
    const double sent_s = earliest_sent_s(message);
    const auto before = std::find(former_.begin(), former_.end(), source);
    if (before != former_.end()) {
      if (sent_s <= since_s_) return Verdict::kLate;
      conflict_ = now;
      former_.erase(before);
    }
    if (present_) former_.push_back(*present_);
    if (former_.size() > kMostFormer) former_.pop_front();
    present_ = source;
    since_s_ = sent_s;
  }
  return conflict_ && now - *conflict_ < kConflict ? Verdict::kConflict : Verdict::kUsed;
}

struct Subscriber::Socket {
  Socket() : context(zmq_ctx_new()), socket(zmq_socket(context, ZMQ_SUB)) {}
  ~Socket() {
    zmq_close(socket);
    zmq_ctx_term(context);
  }
  Socket(const Socket&) = delete;
  Socket& operator=(const Socket&) = delete;

  bool readable(std::chrono::milliseconds timeout) const {
    zmq_pollitem_t item{socket, 0, ZMQ_POLLIN, 0};
    return zmq_poll(&item, 1, timeout.count()) > 0;
  }

  void* context;
  void* socket;
};

Subscriber::Subscriber(const std::string& address, double timeout_s)
    : address_(address), timeout_s_(timeout_s), socket_(std::make_unique<Socket>()), empty_(Clock::now()), heard_(empty_) {
  const int newest_only = 1, linger_ms = 0;
  zmq_setsockopt(socket_->socket, ZMQ_SUBSCRIBE, "", 0);
  zmq_setsockopt(socket_->socket, ZMQ_CONFLATE, &newest_only, sizeof newest_only);
  zmq_setsockopt(socket_->socket, ZMQ_LINGER, &linger_ms, sizeof linger_ms);
  zmq_setsockopt(socket_->socket, ZMQ_MAXMSGSIZE, &kMostBytes, sizeof kMostBytes);
  if (address.rfind("tcp://[", 0) == 0) {  // ZeroMQ refuses IPv6 unless asked
    const int ipv6 = 1;
    zmq_setsockopt(socket_->socket, ZMQ_IPV6, &ipv6, sizeof ipv6);
  }
  if (zmq_connect(socket_->socket, address.c_str()) != 0) {
    throw std::runtime_error(address + ": " + zmq_strerror(zmq_errno()) + "; use ipc://PATH or tcp://HOST:PORT");
  }
}

Subscriber::~Subscriber() = default;

const Message* Subscriber::wait(std::chrono::milliseconds timeout) {
  const auto end = Clock::now() + std::clamp(timeout, std::chrono::milliseconds(0), kLongestWait);
  do {
    const auto left = std::chrono::duration_cast<std::chrono::milliseconds>(end - Clock::now());
    if (receive(std::max(left, std::chrono::milliseconds(0)))) return &*newest_;
  } while (Clock::now() < end);
  return nullptr;
}

const Message* Subscriber::latest() {
  while (receive(std::chrono::milliseconds(0))) {
  }
  return newest_ ? &*newest_ : nullptr;
}

// Receives one message. False: none came, or it was not used.
bool Subscriber::receive(std::chrono::milliseconds timeout) {
  auto received = empty_;  // a message that is there now arrived after the socket was last seen empty
  if (is_empty()) {
    if (!socket_->readable(std::min<std::chrono::milliseconds>(timeout, kSilence))) {
      is_empty();  // what comes next came after this wait
      connect_after_silence();
      return false;
    }
    received = Clock::now();  // it arrived during the wait
  }
  heard_ = Clock::now();
  zmq_msg_t data;
  zmq_msg_init(&data);
  if (zmq_msg_recv(&data, socket_->socket, ZMQ_DONTWAIT) < 0) {
    zmq_msg_close(&data);
    return false;
  }
  is_empty();  // a reader that always finds a message would never look at an empty socket otherwise
  osape::v1::PrismsFrame frame;
  const bool fits = zmq_msg_size(&data) <= static_cast<std::size_t>(std::numeric_limits<int>::max());
  const bool parsed = fits && frame.ParseFromArray(zmq_msg_data(&data), static_cast<int>(zmq_msg_size(&data)));
  zmq_msg_close(&data);
  if (!parsed || frame.schema_version() != kSchemaVersion) {
    ++stats_.undecodable;
    stats_.last_error = address_ + ": not a PrismsFrame of schema version " + std::to_string(kSchemaVersion);
    return false;
  }
  if (!frame.has_publication()) {  // without it the age is not known
    ++stats_.undecodable;
    stats_.last_error = address_ + ": a PrismsFrame that is cut short: the part that is written last is missing";
    return false;
  }
  Message message{std::move(frame), received, timeout_s_};
  const auto verdict = sources_.take(message);
  if (verdict == Sources::Verdict::kConflict) {
    refuse_all();
    return false;
  }
  if (verdict == Sources::Verdict::kLate || !is_newer(message.content)) {
    ++stats_.out_of_order;
    return false;
  }
  ++stats_.messages;
  const std::chrono::duration<double> late(delays_.late_s(message.content));
  message.received = std::min(received, Clock::now() - std::chrono::duration_cast<Clock::duration>(late));
  newest_ = std::move(message);
  return true;
}

bool Subscriber::is_empty() {
  const auto polled = Clock::now();
  if (socket_->readable(std::chrono::milliseconds(0))) return false;
  empty_ = polled;
  return true;
}

void Subscriber::connect_after_silence() {
  const auto now = Clock::now();
  if (now - heard_ < kSilence) return;
  heard_ = now;
  zmq_disconnect(socket_->socket, address_.c_str());  // an error: it is not connected any more
  zmq_connect(socket_->socket, address_.c_str());     // an error: the next silence tries again
}

// Whether a frame was published after the newest one; a restarted service counts from 0 again.
bool Subscriber::is_newer(const osape::v1::PrismsFrame& frame) const {
  if (!newest_) return true;
  const auto &before = newest_->content.publication(), &after = frame.publication();
  const bool other_service = before.boot_id() != after.boot_id() || before.start_ns() != after.start_ns();
  return other_service || after.number() > before.number() || after.number() == 0 || newest_->stale();
}

// Two services publish: makes the newest message stale, which may be that of another vehicle.
void Subscriber::refuse_all() {
  ++stats_.conflicting;
  stats_.last_error = address_ + ": two services publish to this address; nothing of either is used: connect to that of this vehicle alone";
  if (newest_) newest_->timeout_s = 0.0;
}

}  // namespace osape_client
