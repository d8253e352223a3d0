// Queries one message, a file with an osape.v1.PrismsFrame. For each line "x y z radius", or "x y z x y z radius" for the way
// from one point to another, on standard input one line is printed: 0 unknown, 1 free, 2 occupied, and with --allow-open 3 open
// (presumed free). Usage: query FILE [--allow-open]
#include <fstream>
#include <iostream>
#include <iterator>
#include <sstream>
#include <string>
#include <vector>

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
    std::istringstream words(line);
    const std::vector<double> n{std::istream_iterator<double>(words), {}};
    ++number;
    if (!words.eof() || (n.size() != 4 && n.size() != 7)) {
      std::cerr << "line " << number << ": expected x y z radius, or x y z x y z radius\n";
      return 1;
    }
    const auto found = n.size() == 4 ? osape_client::occupancy(frame, {n[0], n[1], n[2]}, n[3], allow_open)
                                     : osape_client::segment_occupancy(frame, {n[0], n[1], n[2]}, {n[3], n[4], n[5]}, n[6], allow_open);
    std::cout << static_cast<int>(found) << '\n';
  }
}
