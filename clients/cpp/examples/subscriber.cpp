// Prints the nearest plane of each frame, and when nothing may be taken as free. Usage: subscriber ADDRESS [COUNT]
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <exception>

#include "osape_client/space.h"
#include "osape_client/subscriber.h"

namespace {

constexpr auto kSilence = std::chrono::milliseconds(500);

void print(const osape_client::Message& message) {
  const auto& frame = message.content;
  if (message.stale()) {
    std::printf("nothing may be taken as free: %.1f s old\n", message.age_s());
  } else if (!frame.valid()) {
    std::printf("nothing may be taken as free: %s\n", frame.cause_text().c_str());
  } else {
    const auto& camera = frame.transform().translation_m();
    std::printf("%s: %d planes, %d prisms, nearest %.2f m, %.0f ms old\n", frame.frame().c_str(),
                frame.planes().margin_m_size(), frame.prisms_size(),
                osape_client::nearest_plane_m(frame.planes(), camera.x(), camera.y()), 1000.0 * message.age_s());
    if (frame.ground().seen()) std::printf("ground %.2f m below the camera\n", frame.ground().height_m());
  }
}

int run(const char* address, long count) {
  osape_client::Subscriber subscriber(address);
  const auto refused = [&] { return subscriber.stats().undecodable + subscriber.stats().conflicting; };
  for (auto before = refused(); count != 0; --count) {
    if (const auto* message = subscriber.wait(kSilence)) {
      print(*message);
    } else if (refused() != before) {
      before = refused();
      std::printf("nothing may be taken as free: %s\n", subscriber.stats().last_error.c_str());
    } else {
      std::printf("nothing may be taken as free: no message on %s; does the service run?\n", address);
    }
  }
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  char* end = nullptr;
  const long count = argc > 2 ? std::strtol(argv[2], &end, 10) : -1;  // -1: without end
  if (argc < 2 || *argv[1] == '-' || argc > 3 || (argc == 3 && (end == argv[2] || *end != '\0' || count < 0))) {
    std::fprintf(stderr, "usage: %s ADDRESS [COUNT]   e.g. ipc:///run/osape-companion/prisms\n", argv[0]);
    return 2;
  }
  std::setvbuf(stdout, nullptr, _IOLBF, 0);
  try {
    return run(argv[1], count);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 1;
  }
}
