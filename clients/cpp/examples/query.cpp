// Queries one message, a file with an osape.v1.PrismsFrame. For each line "x y z radius" on standard input one line is
// printed: 0 unknown, 1 free, 2 occupied, and with --allow-open 3 open (presumed free). Usage: query FILE [--allow-open]
#include <fstream>
#include <iostream>
#include <sstream>
#include <string>

#include "osape_client/space.h"

int main(int argc, char** argv) {
  const bool allow_open = argc == 3 && std::string(argv[2]) == "--allow-open";
  if ((argc != 2 && !allow_open) || *argv[1] == '-') {
    std::cerr << "usage: " << argv[0] << " FILE [--allow-open]   with an osape.v1.PrismsFrame\n";
    return 2;
  }
  std::ifstream file(argv[1], std::ios::binary);
  osape::v1::PrismsFrame frame;
  // an empty file is parsed, too, and has no version
  if (!file || !frame.ParseFromIstream(&file) || frame.schema_version() != 1) {
    std::cerr << argv[1]
              << (file.is_open() ? ": not an osape.v1.PrismsFrame of schema version 1\n" : ": cannot be opened; check the path\n");
    return 1;
  }
  int number = 0;
  for (std::string line; std::getline(std::cin, line);) {
    osape_client::Point p;
    double radius_m;
    std::string more;
    std::istringstream words(line);
    ++number;
    if (!(words >> p.x >> p.y >> p.z >> radius_m) || words >> more) {
      std::cerr << "line " << number << ": expected x y z radius\n";
      return 1;
    }
    std::cout << static_cast<int>(osape_client::occupancy(frame, p, radius_m, allow_open)) << '\n';
  }
}
