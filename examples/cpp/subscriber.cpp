// What a planner in C++ needs: the newest prisms, their age, and the nearest obstacle; space.h answers what is free. Usage: subscriber ADDRESS [COUNT]
//
// Blind, stale and silent are said as what they are: nothing may be taken as free.
#include <zmq.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <limits>

#include "osape_v1.pb.h"

namespace {

constexpr double kStaleS = 0.4;  // the service itself calls a camera blind at 0.3 s
constexpr int kSilenceMs = 500;

double now_s() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

// Metres from (x, y) to the nearest plane seen from above, its margin taken off; infinity without planes.
double nearest_m(const osape::v1::Planes& planes, double x, double y) {
  double least = std::numeric_limits<double>::infinity();
  for (int i = 0; i < planes.margin_m_size() && 6 * i + 5 < planes.corners_m_size(); ++i) {
    const double ax = planes.corners_m(6 * i), ay = planes.corners_m(6 * i + 1);
    const double ux = planes.corners_m(6 * i + 2) - ax, uy = planes.corners_m(6 * i + 3) - ay;
    const double length2 = std::max(ux * ux + uy * uy, 1e-12);
    const double share = std::clamp(((x - ax) * ux + (y - ay) * uy) / length2, 0.0, 1.0);
    least = std::min(least, std::hypot(ax + share * ux - x, ay + share * uy - y) - planes.margin_m(i));
  }
  return least;
}

void tell(const osape::v1::PrismsFrame& frame, double age_s) {
  if (age_s > kStaleS) {
    std::printf("nothing may be taken as free: %.1f s old\n", age_s);
  } else if (!frame.valid()) {
    std::printf("nothing may be taken as free: %s\n", frame.cause_text().c_str());
  } else {
    const auto& camera = frame.transform().translation_m();
    std::printf("%s: %d planes, %d prisms, nearest %.2f m, %.0f ms old\n", frame.frame().c_str(),
                frame.planes().margin_m_size(), frame.prisms_size(),
                nearest_m(frame.planes(), camera.x(), camera.y()), 1000.0 * age_s);
    if (frame.ground().seen()) std::printf("ground %.2f m below the camera\n", frame.ground().height_m());
  }
}

}  // namespace

int main(int argc, char** argv) {
  if (argc < 2) {
    std::fprintf(stderr, "usage: %s ADDRESS [COUNT]   e.g. ipc:///run/osape-companion/prisms\n", argv[0]);
    return 2;
  }
  std::setvbuf(stdout, nullptr, _IOLBF, 0);
  void* context = zmq_ctx_new();
  void* socket = zmq_socket(context, ZMQ_SUB);
  const int newest_only = 1, silence_ms = kSilenceMs, linger_ms = 0;
  zmq_setsockopt(socket, ZMQ_SUBSCRIBE, "", 0);
  zmq_setsockopt(socket, ZMQ_CONFLATE, &newest_only, sizeof newest_only);
  zmq_setsockopt(socket, ZMQ_RCVTIMEO, &silence_ms, sizeof silence_ms);
  zmq_setsockopt(socket, ZMQ_LINGER, &linger_ms, sizeof linger_ms);
  if (zmq_connect(socket, argv[1]) != 0) {
    std::fprintf(stderr, "%s: %s\n", argv[1], zmq_strerror(zmq_errno()));
    return 1;
  }
  for (long left = argc > 2 ? std::atol(argv[2]) : -1; left != 0; --left) {
    zmq_msg_t data;
    zmq_msg_init(&data);
    osape::v1::PrismsFrame frame;
    if (zmq_msg_recv(&data, socket, 0) < 0) {
      std::printf("nothing may be taken as free: no news\n");
    } else if (const double received_s = now_s();
               !frame.ParseFromArray(zmq_msg_data(&data), static_cast<int>(zmq_msg_size(&data))) ||
               frame.schema_version() != 1) {
      std::printf("nothing may be taken as free: not a message of this version\n");
    } else {
      // a planner that keeps the message adds its own time since the receipt whenever it looks
      tell(frame, 1e-9 * static_cast<double>(frame.publication().age_ns()) + (now_s() - received_s));
    }
    zmq_msg_close(&data);
  }
  zmq_close(socket);
  zmq_ctx_term(context);
}
