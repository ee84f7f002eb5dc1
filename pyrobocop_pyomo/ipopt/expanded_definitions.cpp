/* Defined variables of a .nl file, written out before the AMPL Solver Library reads them.
 *
 * A defined variable is an expression that the file holds once and names where it is used; Pyomo's writer makes one of
 * each named Expression. The library's reader for second derivatives (pfgh_read) loses track of some of them: the first
 * and second derivatives are wrong then, without a message. Expressions that are written out are differentiated
 * rightly. So the linker puts this function in front of that reader (--wrap=pfgh_read_ASL): it reads what follows the
 * header, puts each definition in the place of its name, and hands the text on.
 */
#include <cerrno>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <stdexcept>
#include <string>
#include <vector>

#include "asl.h"

/* Bytes that writing out may add; each expression node takes about 5 here, and 150 in the library. */
static const size_t LARGEST_GROWTH = 128u << 20;

class Expansion {
public:
    Expansion(const std::string &text, int variables, int definitions)
        : text(text), variables(variables), definitions(definitions), into(&written), number(-1) {}

    std::string run() {
        for (size_t end; at < text.size(); at = end) {
            end = end_of_line(at);
            const char kind = text[at];
            if (kind == 'V') {
                close_definition();
                end = open_definition();
            } else if (kind == 'v') {
                refer_to(atoi(&text[at + 1]));
            } else if (kind == 'h') {
                end = end_of_string(); /* a string may hold anything, line ends too */
                into->append(text, at, end - at);
            } else {
                if (strchr("CFGJKLOSbdkrx", kind))
                    close_definition(); /* these letters begin a segment */
                into->append(text, at, end - at);
            }
        }
        close_definition();
        return written;
    }

private:
    const std::string &text;
    const int variables;
    std::vector<std::string> definitions; /* written out themselves; empty before they are read */
    std::string written, body, *into;
    std::vector<std::string> terms; /* the linear ones of the definition that is being read */
    size_t at = 0, growth = 0;
    int number; /* of the definition that is being read, or -1 */

    size_t end_of_line(size_t from) const {
        const size_t end = text.find('\n', from);
        return end == std::string::npos ? text.size() : end + 1;
    }

    size_t end_of_string() const {
        char *colon;
        const size_t length = strtoul(&text[at + 1], &colon, 10);
        return end_of_line(colon - text.c_str() + 1 + length);
    }

    /* "V7 2 0" defines variable 7 as a sum of two linear terms, one on each of the next lines, and an expression. */
    size_t open_definition() {
        int index, linear;
        if (sscanf(&text[at], "V%d %d", &index, &linear) != 2 || index < variables
            || index - variables >= (int)definitions.size())
            throw std::runtime_error("a line of it should define a variable, but does not: " + line());
        number = index - variables;
        into = &body;
        size_t end = end_of_line(at);
        for (; linear > 0; --linear, end = end_of_line(at)) {
            at = end;
            char coefficient[64];
            if (sscanf(&text[at], "%d %63s", &index, coefficient) != 2)
                throw std::runtime_error("a line of it should be a linear term, but is not: " + line());
            if (atof(coefficient) != 1.0)
                body.append("o2\nn").append(coefficient).append("\n");
            refer_to(index);
            terms.push_back(body);
            body.clear();
        }
        return end;
    }

    void close_definition() {
        if (number < 0)
            return;
        if (terms.empty() || atof(&body[1]) != 0.0 || body[0] != 'n')
            terms.push_back(body);
        std::string &whole = definitions[number];
        if (terms.size() == 2)
            whole = "o0\n";
        else if (terms.size() > 2)
            whole = "o54\n" + std::to_string(terms.size()) + "\n";
        for (const std::string &term : terms)
            whole += term;
        terms.clear();
        body.clear();
        number = -1;
        into = &written;
    }

    void refer_to(int index) {
        if (index < variables) {
            into->append("v").append(std::to_string(index)).append("\n");
            return;
        }
        if (index - variables >= (int)definitions.size() || definitions[index - variables].empty())
            throw std::runtime_error("it uses a defined variable that it has not defined before: " + line());
        const std::string &whole = definitions[index - variables];
        growth += whole.size();
        if (growth > LARGEST_GROWTH)
            throw std::runtime_error(
                "written out they are longer than " + std::to_string(LARGEST_GROWTH >> 20) + " MB. Give the largest "
                "shared Expressions variables of their own (y == expression), or use a solver that keeps them, "
                "like pyrobocop.ipopt");
        into->append(whole);
    }

    std::string line() const { return text.substr(at, text.find('\n', at) - at); }
};

extern "C" int __real_pfgh_read_ASL(ASL *asl, FILE *file, int flags);

extern "C" int __wrap_pfgh_read_ASL(ASL *asl, FILE *file, int flags) {
    const int count = comb + comc + como + comc1 + como1;
    if (!count)
        return __real_pfgh_read_ASL(asl, file, flags);
    try {
        if (binary_nl)
            throw std::runtime_error("the file is binary. Write it as text (format g)");
        std::string text;
        char block[1 << 16];
        for (size_t read; (read = fread(block, 1, sizeof block, file)) > 0;)
            text.append(block, read);
        fclose(file);
        std::string expanded = Expansion(text, n_var, count).run();
        FILE *memory = fmemopen(&expanded[0], expanded.size(), "r");
        if (!memory)
            throw std::runtime_error(strerror(errno));
        comb = comc = como = comc1 = como1 = 0;
        return __real_pfgh_read_ASL(asl, memory, flags); /* closes it */
    } catch (const std::exception &error) {
        fprintf(stderr, "The %d defined variables of the .nl file cannot be written out, and derivatives would be wrong "
                "otherwise: %s.\n", count, error.what());
        return ASL_readerr_corrupt;
    }
}
