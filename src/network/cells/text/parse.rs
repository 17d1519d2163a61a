//! From the text of an acceleration to its expression.

use pest::Parser;
use pest::error::{ErrorVariant, InputLocation};
use pest::iterators::{Pair, Pairs};
use pest_derive::Parser;

use super::complaint::{Complaint, TextSpan};

/// Longest text, bytes.
const LONGEST: usize = 4000;
/// How deep parentheses and powers may stand in each other: a text must not exhaust the program's stack.
const DEEPEST: usize = 40;

#[derive(Parser)]
#[grammar = "network/cells/text/grammar.pest"]
struct Grammar;

/// A part of a text and what it says.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Expression {
    pub at: TextSpan,
    pub term: Term,
}

#[derive(Debug, Clone, PartialEq)]
pub(super) enum Term {
    Number(f64),
    Name(String),
    /// `expression.name`.
    Part(Box<Expression>, String),
    Negative(Box<Expression>),
    Binary(Operator, Box<Expression>, Box<Expression>),
    Call(String, Vec<Expression>),
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Operator {
    Plus,
    Minus,
    Times,
    Over,
    Raised,
}

/// Parses a text.
///
/// # Errors
/// A text that is too long or too deep, or none of the language.
pub(super) fn parse(text: &str) -> Result<Expression, Complaint> {
    if text.len() > LONGEST {
        let what = format!("the text has {} bytes; at most {LONGEST} are read", text.len());
        return Err(Complaint::new(&(0..0), what));
    }
    check_depth(text)?;
    let mut parsed = Grammar::parse(Rule::equation, text).map_err(|error| complaint(text, &error))?;
    Ok(expression(next(&mut next(&mut parsed).into_inner())))
}

/// A power counts as a parenthesis that ends with its term.
fn check_depth(text: &str) -> Result<(), Complaint> {
    let mut powers_around = Vec::new();
    let mut powers = 0;
    let mut before = ' ';
    for (at, c) in text.char_indices().filter(|(_, c)| !c.is_ascii_whitespace()) {
        // A sign after what is no operand belongs to what follows; one after an e may be of a number's exponent.
        let after_operand = before == ')' || before.is_ascii_alphanumeric() && !before.eq_ignore_ascii_case(&'e');
        match c {
            '^' => powers += 1,
            '(' => powers_around.push(powers),
            ')' => powers = powers_around.pop().unwrap_or(powers),
            '*' | '/' | ',' => powers = powers_around.last().copied().unwrap_or(0),
            '+' | '-' if after_operand => powers = powers_around.last().copied().unwrap_or(0),
            _ => {}
        }
        before = c;
        if powers_around.len() + powers > DEEPEST {
            let what = format!("more than {DEEPEST} parentheses and powers in each other");
            return Err(Complaint::new(&(at..at + 1), what));
        }
    }
    Ok(())
}

fn complaint(text: &str, error: &pest::error::Error<Rule>) -> Complaint {
    let start = match error.location {
        InputLocation::Pos(start) | InputLocation::Span((start, _)) => start,
    };
    let found = match text.get(start..).and_then(|rest| rest.chars().next()) {
        Some(c) => format!("{c:?}"),
        None => "the end".into(),
    };
    let ErrorVariant::ParsingError { positives, .. } = &error.variant else {
        return Complaint::new(&(start..start), "not an expression");
    };
    let mut expected: Vec<&str> = positives.iter().map(|rule| called(*rule)).collect();
    expected.sort_unstable();
    expected.dedup();
    let expected = match expected.split_last() {
        Some((last, [])) => (*last).to_string(),
        Some((last, others)) => format!("{} or {last}", others.join(", ")),
        None => "something else".into(),
    };
    Complaint::new(&(start..start), format!("found {found}, expected {expected}"))
}

/// What people call what the grammar expects.
fn called(rule: Rule) -> &'static str {
    match rule {
        Rule::plus | Rule::minus | Rule::times | Rule::over | Rule::raised => "an operator (+ - * / ^)",
        Rule::of => "a part (.x or .y)",
        Rule::name => "a name",
        Rule::comma => "a comma",
        Rule::open => "an opening parenthesis",
        Rule::close => "a closing parenthesis",
        Rule::EOI => "the end",
        Rule::number
        | Rule::equation
        | Rule::sum
        | Rule::product
        | Rule::signed
        | Rule::power
        | Rule::part
        | Rule::group
        | Rule::call
        | Rule::WHITESPACE => "a number, a name or a parenthesis",
    }
}

fn next<'a>(pairs: &mut Pairs<'a, Rule>) -> Pair<'a, Rule> {
    pairs.next().expect("the grammar has it there")
}

fn span(pair: &Pair<Rule>) -> TextSpan {
    pair.as_span().start()..pair.as_span().end()
}

/// An expression from any of the rules that stand for one.
fn expression(pair: Pair<Rule>) -> Expression {
    let at = span(&pair);
    match pair.as_rule() {
        Rule::number => {
            let number = pair.as_str().parse().expect("the grammar's numbers are Rust's");
            Expression { at, term: Term::Number(number) }
        }
        Rule::name => Expression { at, term: Term::Name(pair.as_str().into()) },
        Rule::call => call(at, pair.into_inner()),
        Rule::group => {
            let inside = pair.into_inner().find(|pair| pair.as_rule() == Rule::sum);
            expression(inside.expect("a parenthesis holds a sum"))
        }
        Rule::part => part(pair.into_inner()),
        Rule::signed => signed(at, pair.into_inner()),
        _ => operations(pair.into_inner()),
    }
}

fn call(at: TextSpan, mut inner: Pairs<Rule>) -> Expression {
    let name = next(&mut inner).as_str().to_string();
    let arguments = inner.filter(|pair| pair.as_rule() == Rule::sum).map(expression).collect();
    Expression { at, term: Term::Call(name, arguments) }
}

fn part(mut inner: Pairs<Rule>) -> Expression {
    let whole = expression(next(&mut inner));
    inner.filter(|pair| pair.as_rule() == Rule::name).fold(whole, |whole, name| {
        let at = whole.at.start..span(&name).end;
        Expression { at, term: Term::Part(Box::new(whole), name.as_str().into()) }
    })
}

/// Any number of signs, of which only whether the minus signs are even or odd counts.
fn signed(at: TextSpan, inner: Pairs<Rule>) -> Expression {
    let mut minuses = 0;
    let mut of = None;
    for pair in inner {
        match pair.as_rule() {
            Rule::minus => minuses += 1,
            Rule::plus => {}
            _ => of = Some(expression(pair)),
        }
    }
    let of = of.expect("signs stand before something");
    if minuses % 2 == 0 { of } else { Expression { at, term: Term::Negative(Box::new(of)) } }
}

/// First operand, then operators and operands by turns, taken from the left. A power has only one operator: the rest of
/// its chain is in the second operand.
fn operations(mut inner: Pairs<Rule>) -> Expression {
    let mut whole = expression(next(&mut inner));
    while let Some(operator) = inner.next() {
        let operator = match operator.as_rule() {
            Rule::plus => Operator::Plus,
            Rule::minus => Operator::Minus,
            Rule::times => Operator::Times,
            Rule::over => Operator::Over,
            _ => Operator::Raised,
        };
        let operand = expression(next(&mut inner));
        let at = whole.at.start..operand.at.end;
        whole = Expression { at, term: Term::Binary(operator, Box::new(whole), Box::new(operand)) };
    }
    whole
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The expression with all parentheses.
    fn written(expression: &Expression) -> String {
        match &expression.term {
            Term::Number(number) => number.to_string(),
            Term::Name(name) => name.clone(),
            Term::Part(whole, name) => format!("{}.{name}", written(whole)),
            Term::Negative(of) => format!("(-{})", written(of)),
            Term::Binary(operator, a, b) => {
                let sign = match operator {
                    Operator::Plus => '+',
                    Operator::Minus => '-',
                    Operator::Times => '*',
                    Operator::Over => '/',
                    Operator::Raised => '^',
                };
                format!("({}{sign}{})", written(a), written(b))
            }
            Term::Call(name, arguments) => {
                format!("{name}({})", arguments.iter().map(written).collect::<Vec<_>>().join(","))
            }
        }
    }

    #[test]
    fn operators_bind_as_in_mathematics() {
        for (text, expected) in [
            ("a - b - c", "((a-b)-c)"),
            ("a / b * c", "((a/b)*c)"),
            ("a + b * c ^ 2", "(a+(b*(c^2)))"),
            ("-x^2", "(-(x^2))"),
            ("2^-x^y", "(2^(-(x^y)))"),
            ("a*-b", "(a*(-b))"),
            ("--+-a", "(-a)"),
            ("(a + b).x * 1.5e-3", "((a+b).x*0.0015)"),
            ("f(a, g(), .5)", "f(a,g(),0.5)"),
            ("p1 -\n  p2", "(p1-p2)"),
        ] {
            assert_eq!(written(&parse(text).unwrap()), expected, "{text}");
        }
    }

    #[test]
    fn what_is_not_the_language_is_refused_with_its_place() {
        for (text, expected) in [
            ("", "column 1: found the end, expected a number, a name or a parenthesis"),
            ("k *", "column 4: found the end, expected a number, a name or a parenthesis"),
            ("2 k", "column 3: found 'k', expected"),
            ("(a + b", "column 7: found the end, expected"),
            ("a + b)", "column 6: found ')', expected"),
            ("a $ b", "column 3: found '$', expected"),
            ("f(a,)", "column 5: found ')', expected a number, a name or a parenthesis"),
            ("p.", "column 3: found the end, expected a name"),
            ("k · x", "column 3: found '·', expected"),
        ] {
            let shown = parse(text).unwrap_err().shown(text);
            assert!(shown.starts_with(expected), "{text:?}: {shown}");
        }
    }

    #[test]
    fn no_text_exhausts_the_stack() {
        for text in ["(".repeat(3000), "2^".repeat(1500), "f(".repeat(1500), "(2^".repeat(900), "-2^-".repeat(900)] {
            let error = parse(&text).unwrap_err();
            assert!(error.what.contains("in each other"), "{error:?}");
        }
        let long = "a".repeat(LONGEST + 1);
        assert!(parse(&long).unwrap_err().what.contains("at most 4000"));
        assert!(parse(&("-".repeat(3000) + "a")).is_ok());
        assert!(parse(&("a".to_string() + &"+a".repeat(1900))).is_ok());
        assert!(parse(&("a".to_string() + &".x".repeat(1900))).is_ok());
        // Powers side by side stand in no other.
        assert!(parse(&("a^2".to_string() + &" + (a * b^-2)^2".repeat(200))).is_ok());
        // A sign of an exponent, or of a number's, ends no term.
        for text in ["2^-".repeat(900), "2^1e-1^".repeat(400)] {
            assert!(parse(&(text + "2")).unwrap_err().what.contains("in each other"));
        }
        assert!(parse(&"-".repeat(3000)).is_err());
    }
}
