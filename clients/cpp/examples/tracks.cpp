// Prints the tracked obstacles of one message, a file with an osape.v1.Tracks, and where moving ones are 0.5 s later.
// Usage: tracks FILE
#include <cstdio>
#include <fstream>

#include "osape_client/tracks.h"

int main(int argc, char** argv) {
  if (argc != 2 || *argv[1] == '-') {
    std::fprintf(stderr, "usage: %s FILE   with an osape.v1.Tracks\n", argv[0]);
    return 2;
  }
  std::ifstream file(argv[1], std::ios::binary);
  if (!file) {
    std::fprintf(stderr, "%s: cannot be opened; check the path\n", argv[1]);
    return 1;
  }
  osape::v1::Tracks message;
  const bool parsed = message.ParseFromIstream(&file) && message.schema_version() == 1;  // an empty file is parsed, too
  const auto tracks = parsed ? osape_client::tracks_of(message) : std::nullopt;
  if (!tracks) {
    std::fprintf(stderr, "%s: not an osape.v1.Tracks of schema version 1, or damaged\n", argv[1]);
    return 1;
  }
  if (!message.valid()) std::puts("nothing may be taken as free: the frame of these tracks is not valid");
  if (message.left_out() != 0) std::printf("%u detected obstacles have no track\n", message.left_out());
  for (const auto& t : *tracks) {
    std::printf("track %llu a %.3f %.3f b %.3f %.3f margin %.3f confidence %.3f state %d\n",
                static_cast<unsigned long long>(t.id), t.ax_m, t.ay_m, t.bx_m, t.by_m, t.margin_m, t.confidence,
                static_cast<int>(t.state));
  }
  for (const auto& o : message.objects()) {
    const auto at = osape_client::predicted(o, 0.5);
    std::printf("moving %llu at %.3f %.3f sigma %.3f\n", static_cast<unsigned long long>(o.id()), at.x_m, at.y_m, at.sigma_m);
  }
  return 0;
}
