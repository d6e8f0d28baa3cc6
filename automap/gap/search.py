"""The search: which set of candidates a model is missing, each round about the last one's fit.

A round makes the fit linear in all candidates, selects the set that the data speak for, fits that
set as states of the filter together with the noise levels, and begins again about that fit, until
the set stays. Noise that was fitted without an effect has swallowed part of it: so candidates are
also proposed under the noise that the model was asked with, and judged with the noise fitted.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import replace
from itertools import count

from automap.effects import CATALOGUE
from automap.effects.catalogue import pairs_of_sign
from automap.gap import limits
from automap.gap.bias_drift import BiasDrift, loose, steady
from automap.gap.candidates import FIX_AGE, is_course
from automap.gap.confirm import Confirmed, confirmed
from automap.gap.drive import OpenDrive
from automap.gap.found import Found, in_layout
from automap.gap.judge import Judge
from automap.gap.noise import Fitted, Log, fitted_about, with_levels, with_noise
from automap.gap.reforming import WHOLE_DELAYS, Forms, log_prior
from automap.gap.scoring import likelier
from automap.gap.screening import Screening
from automap.gap.selection import Chosen, Key, Selection
from automap.gap.stepwise import close_rivals, pruned, select


class Search:
    """A search on drives that were fitted, and on others, ``held_out``, that judge between models;
    ``exclude`` effects that the library does without."""

    def __init__(
        self,
        base: Fitted,
        held_out: Sequence[OpenDrive],
        stated: Mapping[str, float],
        exclude: Collection[str],
        log: Log,
    ) -> None:
        self.base, self.held_out, self.stated, self.log = base, held_out, dict(stated), log
        self.judge = Judge(held_out)
        self.screening = Screening(base, exclude, log)
        self.borne_out: dict[str, float] = {}
        self.drift = BiasDrift(self.screening, self.judge, self.borne_out, log)
        self.forms = Forms(self.screening, self.judge, self.drift.without, stated)
        self.close: dict[str, tuple[str, ...]] = {}
        self.tried: dict[Key, int] = {}
        self.challenged: set[tuple[frozenset[frozenset[str]], bool]] = set()
        self.outdone: set[tuple[str, str]] = set()
        self.compared: Counter[tuple[str, str]] = Counter()
        self.spoken_against: list[Confirmed] = []
        self.stands = Confirmed({}, ())
        self.each_drive: list[str] = []
        self.levels = {(frozenset[Key](), 0): base.model.factors}
        self.before: tuple[Fitted, Selection, Chosen] | None = None

    def run(self) -> Found:
        """Rounds until the set stays: first without courses of time, then with them."""
        here, slow = self.base, False
        # noise that was fitted without an effect has swallowed part of it
        louder: Mapping[str, float] | None = self.stated
        selection = self.screening.selection(here, slow)
        chosen, fitted = Chosen(), frozenset[Key]()
        for number in count():
            selection.refused = frozenset(k for k, n in self.tried.items() if n >= limits.TRIALS)
            selection.outdone = frozenset(self.outdone)
            self.log(f"selecting beside {', '.join(chosen.names) or 'nothing'}")
            closing = number >= limits.MAX_ROUNDS - limits.CLOSING_ROUNDS
            ending = number >= limits.MAX_ROUNDS
            limit = len(chosen.names) if closing else limits.MAX_FINDINGS
            kept, new = chosen, None
            if not ending:
                kept, new = self._kept(here, selection, chosen, select(selection, chosen, limit))
            found = kept
            # not beside what is not fitted yet: what that leaves beyond the linear looks like more
            if louder is not None and not closing and selection.keys(found) == fitted:
                self.log("selecting under other noise")
                found = self._proposed(here, selection, found, louder, slow)
                louder = None
            keys = selection.keys(found)
            for key in keys - fitted:
                self.tried[key] = self.tried.get(key, 0) + 1
            if keys != fitted:
                found, brief = self.screening.refined(here, selection, found)
                self._bar(brief)
                idle: list[str] = []
                if selection.keys(found) != fitted:
                    if new is None or found != kept:
                        new = self._fit(here, selection, found)
                    new, found = self._better_twins(here, new, selection, found)
                    idle = self.screening.not_borne_out(new, selection, found)
                    # these parameters do not act; others of the same effect may
                    out = Chosen(tuple(p for p in found.parts if p[0] in idle))
                    self._bar(selection.alike(out))
                    for name in idle:
                        found = found.without(name)
                if selection.keys(found) == fitted:
                    # nothing came that is seen as what it was taken for and borne out
                    chosen = found
                    continue
                # what is not told must not stay in the model
                here = self._fit(new or here, selection, found) if idle else new or here
                del new
            else:
                last = slow or closing
                ask = self._reconsidered if last else self.forms.better
                other = ask(here, selection, found, ending)
                if other is not None:
                    found, brief = self.screening.refined(here, selection, other)
                    self._bar(brief)
                    here = self._fit(here, selection, found)
                    acting = self._acting(here, selection, found)
                    if acting != found:
                        found = acting
                        here = self._fit(here, selection, found)
                elif last:
                    break
                else:
                    slow, louder = True, steady(here.model.factors)
                    self.before = here, selection.without_rows(), found
            fitted, layout = selection.keys(found), selection.linear.layout
            # the rows of one are as many as there is room for
            del selection
            selection = self.screening.selection(here, slow)
            selection.needed = frozenset(self.borne_out)
            chosen = in_layout(found, layout, selection)
        self.log("fitting all parameters")
        free = replace(here.model, options=self.screening.options)
        full = fitted_about(free, self._with_age(here.estimate), here.fits).joint()
        nothing_else = self.screening.selection(here, slow=False, may_act=False)
        resembling = self.forms.resembling.items()
        return Found(
            *(self.base, here, full, selection, chosen, self.screening.effects),
            {**self.forms.alike, **self.close},
            *(self.stands.after(self.spoken_against), nothing_else),
            self.borne_out | self.drift.nats,
            {n: text for (n, beside), text in resembling if {n, *beside} == {*chosen.names}},
            self.drift.beside(selection, chosen),
        )

    def _with_age(self, estimate: Mapping[str, float]) -> Mapping[str, float]:
        """What is estimated, with the age of all fixes where velocities are told to be older than
        positions, of which nobody says that they are of their own instant: what is sure is how old
        velocities are by the unit's stamps."""
        older = any(pair[0] in estimate or pair[1] in estimate for pair in pairs_of_sign(1.0))
        named = any(effect in estimate for effect in WHOLE_DELAYS)
        known = named or FIX_AGE not in self.screening.names
        return {**estimate, FIX_AGE: 1.0} if older and not known else estimate

    def _kept(
        self, here: Fitted, selection: Selection, chosen: Chosen, found: Chosen
    ) -> tuple[Chosen, Fitted | None]:
        """A selection, or what was chosen before where that only drops from it what the filter does
        not: beside a noise that was fitted with a candidate that one is not needed, and without it
        the noise grows to take its place. Each model is asked with the noise that suits it. With
        a selection comes its fit where that was needed to tell."""
        gone = [n for n in chosen.names if n not in found.names]
        if not gone or any(n not in chosen.names for n in found.names):
            return found, None
        fewer = self._fit(here, selection, found)
        of_vehicle = loose(selection, chosen, gone)
        ahead, sigmas = self.judge.ahead(here, fewer, of_vehicle, strictly=True)
        ahead += selection.log_prior(chosen) - selection.log_prior(found)
        if ahead < limits.LEAST_ODDS or sigmas < limits.APART:
            return found, fewer
        self.borne_out |= dict.fromkeys(gone, ahead)
        selection.needed = frozenset(self.borne_out)
        return chosen, None

    def _acting(self, here: Fitted, selection: Selection, found: Chosen) -> Chosen:
        """A set without what is nothing by its values: of what came together in the place of
        another one alone may do it."""
        joint = here.joint()
        worth = {n: self.screening.nats(joint, selection, found, n) for n in found.names}
        weakest = min(worth, key=lambda n: worth[n], default="")
        return found.without(weakest) if worth.get(weakest, 0.0) < 0.0 else found

    def _bar(self, keys: Iterable[Key]) -> None:
        """Try parts no more."""
        self.tried |= dict.fromkeys(keys, limits.TRIALS)

    def _reconsidered(
        self, here: Fitted, selection: Selection, found: Chosen, ending: bool
    ) -> Chosen | None:
        """Another set, where noise as it really is, rivals or held-out data speak against one that
        nothing can be added to, a smaller one where the search is ``ending``; None where nothing
        does."""
        if self.before is not None:
            earlier, its_selection, without = self.before
            self.before = None
            new = set(found.names) - set(without.names)
            ahead, _ = self.judge.ahead(here, earlier, loose(selection, found, new))
            ahead += selection.log_prior(found) - its_selection.log_prior(without)
            if without.names != found.names and ahead < 0.0:
                # courses of time follow what a name says better
                self._bar(selection.keys(found) - its_selection.keys(without))
                return in_layout(without, its_selection.linear.layout, selection)
        selection.inflate(found)
        fewer = pruned(selection, found)
        if fewer != found:
            idle = Chosen(tuple(p for p in found.parts if p not in fewer.parts))
            self._bar(selection.alike(idle))
            return fewer
        if not ending:
            formed = self.forms.better(here, selection, found, ending)
            if formed is not None:
                return formed
        rival = self._decided(here, selection, found, ending)
        if rival is not None:
            pair = frozenset({frozenset(found.names), frozenset(rival.names)})
            new = set(rival.names) - set(found.names)
            to_names = not any(selection.candidates[name].terms for name in new)
            if (pair, to_names) not in self.challenged:
                # decided once, or once to a formula and once back to the name that it took the
                # place of; either may be asked again beside a third that came in between
                self.challenged.add((pair, to_names))
                return rival
        fewer = self.drift.needed(here, selection, found)
        selection.needed = frozenset(self.borne_out)
        if fewer != found:
            self._bar(selection.keys(found) - selection.keys(fewer))
            return fewer
        more = self.drift.behind(here, selection, found)
        if more is not None and not ending:
            return more
        self.log("checking on held-out data")
        self.judge.forget()
        effects = self.screening.effects
        # there are hundreds of formulas, so one must be borne out there; not so a course of time,
        # which other drives need not have
        terms = {effects[name]: selection.candidates[name].terms for name in found.names}
        doubtful = [effect for effect, its in terms.items() if its and not is_course(its)]
        self.stands = confirmed(self.held_out, here.model, here.values(), doubtful)
        gone = [name for name in found.names if effects[name] not in self.stands.values]
        if not gone:
            return None
        self._free_delays([effects[name] for name in gone])
        out = [replace(k, each_drive=k.effect in self.each_drive) for k in self.stands.kept_out]
        self.spoken_against.append(replace(self.stands, kept_out=tuple(out)))
        for name in gone:
            self._bar(selection.key(name, part) for part in selection.candidates[name].parts)
            found = found.without(name)
        return found

    def _free_delays(self, effects: Iterable[str]) -> None:
        """Fit a receiver's delays that held-out data do not know at the same value on every drive
        anew: without them, other candidates follow what a delay does."""
        for effect in effects:
            known = CATALOGUE[effect]
            if known.family != "gnss" or known.resembles != "a delay":
                continue
            state = known.first_order[0] if known.first_order else effect
            options = self.screening.options
            if state not in options.effects:
                self.each_drive.append(effect)
                self.screening.options = replace(options, effects=(*options.effects, state))

    def _fit(self, here: Fitted, selection: Selection, chosen: Chosen) -> Fitted:
        """The chosen set as states, with the noise that suits it; where that was fitted before, or
        with other forms of its formulas, that noise, as far as these and another path do not move
        it."""
        self.log(f"fitting {', '.join(chosen.names) or 'the base model'} with its noise")
        keys = selection.keys(chosen)
        seeds = frozenset((self.screening.seed(name), own) for name, own in keys)
        asked = seeds, len(self.each_drive)
        known = self.levels.get(asked, here.model.factors)
        begun = replace(here, model=replace(here.model, factors=known))
        states = replace(self.screening.states(begun, selection, chosen), curvature=here.curvature)
        fitted = with_levels(states) if asked in self.levels else with_noise(states, self.stated)
        self.levels[asked] = fitted.model.factors
        return fitted

    def _better_twins(
        self, about: Fitted, here: Fitted, selection: Selection, chosen: Chosen
    ) -> tuple[Fitted, Chosen]:
        """The fit and the choice with what acts as a chosen effect does to first order in its
        place, where the filter, which knows more than that, finds the drives likelier; both begin
        ``about`` the same fit, for beside a wrong twin other delays go where they do not belong."""
        for one, other in pairs_of_sign(1.0):
            for name, twin in ((one, other), (other, one)):
                if name not in chosen.names or twin not in selection.candidates:
                    continue
                if (name, twin) in self.outdone or self.compared[name, twin] == limits.TRIALS:
                    # beside what has come since it is asked again as a rival
                    continue
                self.compared[name, twin] += 1
                self.log(f"checking whether {name} is {twin}")
                acts = selection.candidates[twin].parts[0]
                instead = Chosen(
                    tuple((twin, acts, p[2]) if p[0] == name else p for p in chosen.parts)
                )
                # each with the noise that suits it: what follows badly is taken for noise
                fitted = self._fit(about, selection, instead)
                _, sigmas = likelier(fitted.fits, here.fits)
                # a long low-pass has the row of a short one, and draws itself out
                least = -limits.APART if CATALOGUE[twin].first_order else limits.APART
                if abs(sigmas) > limits.APART:
                    self.outdone.add((twin, name) if sigmas > 0.0 else (name, twin))
                if sigmas > least:
                    return fitted, instead
                break
        return here, chosen

    def _decided(
        self, here: Fitted, selection: Selection, chosen: Chosen, ending: bool = False
    ) -> Chosen | None:
        """The choice with a rival in a candidate's place where the filter itself, which knows what
        is not linear, finds all drives likelier with it; None where no rival is.

        A formula is told only where it is told apart from every name and explains a tenth more: one
        that follows a name so closely is that name, and something else is a little off. What is
        not told apart from a name that stays is noted. A search that is ``ending`` asks for that
        alone.
        """
        self.close = self.close if ending else {}
        against = {out.effect for one in self.spoken_against for out in one.kept_out}
        joint = here.joint()
        for name in chosen.names:
            formula = bool(selection.candidates[name].terms)
            if ending and not formula:
                continue
            best, instead, winner = 0.0, None, ""
            nats = self.screening.nats(joint, selection, chosen, name)
            for rival in close_rivals(selection, chosen, name):
                other = rival.name
                its, brief = self.screening.refined(here, selection, rival.chosen)
                same = frozenset(its.names) == frozenset(chosen.names)
                own = self.screening.seed(other) == self.screening.seed(name)
                if ending and selection.candidates[other].terms:
                    continue
                if same or own or brief or self.screening.effects.get(other, other) in against:
                    continue
                other = its.names[-1]
                self.log(f"checking whether {name} is {other}")
                fitted = self.screening.states(here, selection, its)
                if {other, name} & set(self.screening.not_borne_out(fitted, selection, its)):
                    continue
                of_vehicle = selection.of_vehicle(chosen, {name})
                of_vehicle |= selection.of_vehicle(its, {other})
                rival_formula = bool(selection.candidates[other].terms)
                strictly = formula != rival_formula
                ahead, sigmas = self.judge.ahead(fitted, here, of_vehicle, strictly)
                ahead += log_prior(selection, its) - log_prior(selection, chosen)
                if abs(sigmas) < limits.APART and not rival_formula:
                    self.close[name] = (*self.close.get(name, ()), other)
                clear = abs(sigmas) > limits.APART and abs(ahead) > limits.CHALLENGE * nats
                clear |= abs(sigmas) > limits.ONE_IN_A_THOUSAND
                wins = ahead > (limits.CLOSE_NATS if formula and rival_formula else 0.0)
                if formula and not rival_formula and not clear:
                    # of several names the likeliest
                    wins = True
                elif rival_formula and not formula:
                    wins &= clear
                if wins and (instead is None or ahead > best):
                    best, instead, winner = ahead, its, other
            formed = None if formula else self.forms.in_place(here, selection, chosen, name, nats)
            if formed is not None and formed[0] > best:
                best, instead, winner = formed[0], formed[1], formed[1].names[-1]
            if instead is not None:
                self.outdone.add((winner, name))
                return instead
        return None

    def _proposed(
        self,
        here: Fitted,
        selection: Selection,
        found: Chosen,
        factors: Mapping[str, float],
        slow: bool,
    ) -> Chosen:
        """The choice with what is proposed under other noise beside it."""
        model = replace(here.model, factors=dict(factors))
        loud = self.screening.selection(fitted_about(model, here.estimate, here.fits), slow)
        loud.refused, loud.outdone = selection.refused, selection.outdone
        known = in_layout(found, selection.linear.layout, loud)
        more = select(loud, known, limits.MAX_FINDINGS)
        new = Chosen(tuple(p for p in more.parts if p[0] not in found.names))
        # drift is one level of all axes: one that is left to it keeps it up
        new = selection.whole(in_layout(new, loud.linear.layout, selection))
        return Chosen((*found.parts, *new.parts))
