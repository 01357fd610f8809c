/** Accepting and declining the offer to download a log after a landing, and the choice of what happens then. */

import { ofVehicle, type ApiClient, type Outcome } from '../../api/client';
import type { Problem } from '../../api/problems';
import type { components } from '../../api/schema';
import { CommandGate, DOUBLE_CLICK } from '../../app/actions/command.svelte';

export type Choice = components['schemas']['AfterLandingChoice']['choice'];
export const CHOICES: readonly { value: Choice; text: string }[] = [
  { value: 'never', text: 'Nothing' },
  { value: 'offer', text: 'Offer' },
  { value: 'download', text: 'Download' },
];

export class AfterLanding {
  /** What happens after each landing; null: not read yet. */
  choice = $state<Choice | null>(null);
  /** Why the last request failed; null: it did not. `vehicle` is null for the choice. */
  private lastProblem = $state.raw<{ readonly vehicle: string | null; readonly problem: Problem } | null>(null);

  constructor(
    private readonly api: ApiClient,
    private readonly gate = new CommandGate(),
  ) {}

  /** Why the last request about this vehicle (null: about the choice) failed. */
  problemOf(vehicle: string | null): Problem | null {
    return this.lastProblem?.vehicle === vehicle ? this.lastProblem.problem : null;
  }

  /** Reads what the server does after a landing. */
  async read(): Promise<void> {
    const answer = await this.api.get('/logs_after_landing');
    if (answer.ok) this.choice = answer.value.choice;
    else this.lastProblem = { vehicle: null, problem: answer.problem };
  }

  /** Sets what the server does after each landing. */
  async choose(choice: Choice): Promise<void> {
    const request = this.gate.run({ name: 'Logs after a landing', vehicles: [], part: choice }, () =>
      this.api.post('/logs_after_landing', { body: { choice } }),
    );
    const answer = this.noted(null, await request);
    if (answer.ok) this.choice = answer.value.choice;
  }

  /** Downloads the logs of these vehicles' newest flights, one after the other. */
  async download(vehicles: readonly string[]): Promise<void> {
    for (const vehicle of vehicles) {
      const answer = await this.gate.run({ name: 'Download the log of the flight', vehicles: [vehicle] }, () =>
        this.api.post('/vehicles/{v}/logs/after_landing', ofVehicle(vehicle)),
      );
      this.noted(vehicle, answer);
    }
  }

  /** Declines the offer, or cancels the download; what has arrived stays. */
  async decline(vehicle: string): Promise<void> {
    const answer = await this.gate.run({ name: 'Decline the log of the flight', vehicles: [vehicle] }, () =>
      this.api.delete('/vehicles/{v}/logs/after_landing', ofVehicle(vehicle)),
    );
    this.noted(vehicle, answer);
  }

  private noted<T>(vehicle: string | null, answer: Outcome<T>): Outcome<T> {
    if (answer.ok) this.lastProblem = null;
    else if (answer.problem.code !== DOUBLE_CLICK) this.lastProblem = { vehicle, problem: answer.problem };
    return answer;
  }
}
