// Queries one message, a file with an osape.v1.PrismsFrame. For each line "x y z radius" on standard input one line is
// printed: 0 unknown, 1 free, 2 occupied, and with --allow-open 3 open (presumed free). Usage: query FILE [--allow-open]
#include <fstream>
#include <iostream>
#include <string>

#include "osape_client/space.h"

int main(int argc, char** argv) {
  if (argc < 2) {
    std::cerr << "usage: " << argv[0] << " FILE [--allow-open]   with an osape.v1.PrismsFrame\n";
    return 2;
  }
  std::ifstream file(argv[1], std::ios::binary);
  osape::v1::PrismsFrame frame;
  if (!file || !frame.ParseFromIstream(&file)) {
    std::cerr << argv[1] << (file.is_open() ? ": not an osape.v1.PrismsFrame\n" : ": cannot be opened; check the path\n");
    return 1;
  }
  const bool allow_open = argc > 2 && std::string(argv[2]) == "--allow-open";
  osape_client::Point p;
  for (double radius_m; std::cin >> p.x >> p.y >> p.z >> radius_m;) {
    std::cout << static_cast<int>(osape_client::occupancy(frame, p, radius_m, allow_open)) << '\n';
  }
}
